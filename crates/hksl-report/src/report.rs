//! Comparison of runs: aggregate scores with confidence intervals, learning curves, figures and an HTML page.
//!
//! [`collect()`] reads runs and published curves, [`Report::new`] computes statistics and draws figures,
//! [`Report::files`] returns the files to write. The [`statistics`](crate::statistics) are of scores: returns divided
//! by 1,000 on control tasks, returns on Falling Pixels. Control tasks are never averaged with Falling Pixels, nor
//! methods with ablations.

mod collect;
mod collected;
mod comparison;
mod curves_csv;
mod error;
mod figure;
mod figures;
mod findings;
mod missing;
mod options;
mod page;
mod record;
mod rectangle;
mod skipped;
mod suite;
mod table;

use std::collections::BTreeSet;

use hksl_files::Outline;
use rayon::prelude::*;

pub use collect::collect;
pub use collected::Collected;
pub use comparison::{Comparison, Task};
pub use error::{Error, Result};
pub use figure::Figure;
pub use findings::{ByVariant, Estimates, Findings, Learning, LearningPoint, TaskScore};
pub use missing::Missing;
pub use options::Options;
pub use record::{OwnRun, Record};
pub use suite::{Question, Suite};
pub use table::Table;

use crate::plot::png;

/// PNG pixels per SVG pixel.
const SCALE: f32 = 2.0;

/// A file of the report.
#[derive(Debug, Clone, PartialEq)]
pub struct File {
    /// Its path in the report's folder.
    pub name: String,
    /// Its content.
    pub bytes: Vec<u8>,
}

/// A report on a set of runs.
#[derive(Debug, Clone)]
pub struct Report {
    /// The figures of each comparison.
    pub figures: Vec<Figure>,
    /// Tables that belong to no figure, by name: `aggregates`, `scores`, `missing`, `runs`.
    pub tables: Vec<(&'static str, Table)>,
    /// Aggregates by comparison and method, formatted for the terminal.
    pub summary: Table,
    /// Exclusions and caveats, as sentences.
    pub skipped: Vec<String>,
    /// Unfinished and missing runs.
    pub missing: Vec<Missing>,
    /// The HTML page.
    pub page: String,
}

impl Report {
    /// Computes the statistics and draws the figures. `study` lists the expected runs; `command` is shown on the page.
    ///
    /// # Errors
    /// Runs that cannot be compared ([`Error`]), an invalid number of replicates.
    pub fn new(
        collected: &Collected,
        options: &Options,
        study: Option<&Outline>,
        command: &str,
    ) -> Result<Self> {
        let records = filtered(&collected.records, options, study)?;
        let comparisons = Comparison::all(&records, &collected.names, options)?;
        let missing = missing::missing(collected, &comparisons, options, study);
        let skipped = skipped::skipped(collected, &comparisons, study);
        let findings = comparisons.into_iter().map(|comparison| Findings::new(comparison, options));
        let findings: Vec<Findings> = findings.collect::<Result<_>>()?;
        let figures = findings.par_iter().map(|findings| figures::figures(findings, options));
        let figures: Vec<Vec<Figure>> = figures.collect::<Result<_>>()?;
        let comparisons: Vec<&Comparison> =
            findings.iter().map(|findings| &findings.comparison).collect();
        let tables = vec![
            ("aggregates", table::aggregates(&findings)),
            ("scores", table::scores(&findings)),
            ("missing", table::missing(&missing)),
            ("runs", table::runs(&records, &comparisons)),
        ];
        let content = page::Content {
            records: &records,
            findings: &findings,
            figures: &figures,
            skipped: &skipped,
            missing: &missing,
            options,
            study,
            command,
        };
        let page = page::render(&content)?;
        let summary = table::summary(&findings);
        let figures = figures.into_iter().flatten().collect();
        Ok(Self { figures, tables, summary, skipped, missing, page })
    }

    /// All files: `index.html`; `figures/NAME.svg`, `figures/NAME.png` and `tables/NAME.csv` of each figure;
    /// `tables/NAME.csv` of each other table.
    ///
    /// # Errors
    /// A figure that cannot be drawn.
    pub fn files(&self) -> Result<Vec<File>> {
        let file = |name: String, bytes: Vec<u8>| File { name, bytes };
        let drawn = self.figures.par_iter().map(|figure| {
            let Figure { name, svg, table, .. } = figure;
            Ok([
                file(format!("figures/{name}.svg"), svg.clone().into_bytes()),
                file(format!("figures/{name}.png"), png(svg, SCALE)?),
                file(format!("tables/{name}.csv"), table.csv()?),
            ])
        });
        let drawn: Vec<[File; 3]> = drawn.collect::<Result<_>>()?;
        let mut files = vec![file("index.html".to_owned(), self.page.clone().into_bytes())];
        files.extend(drawn.into_iter().flatten());
        for (name, table) in &self.tables {
            files.push(file(format!("tables/{name}.csv"), table.csv()?));
        }
        Ok(files)
    }
}

/// Selects the runs of the requested variants and tasks. Each must exist or be planned.
fn filtered(records: &[Record], options: &Options, study: Option<&Outline>) -> Result<Vec<Record>> {
    let planned = study.map_or_else(BTreeSet::new, planned_names);
    let check = |kind: &'static str, asked: &[String], of: &dyn Fn(&Record) -> String| {
        let there: BTreeSet<String> = records.iter().map(of).collect();
        let known = |name: &&String| there.contains(*name) || planned.contains(*name);
        let unknown: Vec<String> = asked.iter().filter(|name| !known(name)).cloned().collect();
        if unknown.is_empty() {
            return Ok(());
        }
        Err(Error::UnknownFilter { kind, unknown, there: there.into_iter().collect() })
    };
    check("method", &options.methods, &|record| record.variant.clone())?;
    check("task", &options.tasks, &Record::task_label)?;
    let kept = records.iter().filter(|record| options.wants(&record.variant, &record.task_label()));
    let kept: Vec<Record> = kept.cloned().collect();
    if kept.is_empty() {
        let (methods, tasks) = (options.methods.clone(), options.tasks.clone());
        return Err(Error::FilteredOut { methods, tasks });
    }
    Ok(kept)
}

/// Variants and tasks of a study.
fn planned_names(study: &Outline) -> BTreeSet<String> {
    study.runs.iter().flat_map(|(variant, task, _)| [variant.clone(), task.clone()]).collect()
}
