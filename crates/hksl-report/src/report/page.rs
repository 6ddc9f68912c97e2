//! The HTML page, a single file that needs no network.

use std::collections::{BTreeMap, BTreeSet};

use hksl_files::Outline;
use hksl_files::numbers::grouped;
use minijinja::Environment;
use minijinja::value::Serde;
use serde_json::{Value, json};

use super::error::{Error, Result};
use super::figure::Figure;
use super::findings::Findings;
use super::missing::Missing;
use super::options::Options;
use super::record::Record;
use super::table::written;
use crate::plot::themed;
use crate::statistics::CONFIDENCE;

const TEMPLATE: &str = include_str!("page.html");

/// Content of the page.
pub(super) struct Content<'a> {
    pub records: &'a [Record],
    pub findings: &'a [Findings<'a>],
    /// Figures of each of the `findings`.
    pub figures: &'a [Vec<Figure>],
    pub skipped: &'a [String],
    pub missing: &'a [Missing],
    pub options: &'a Options,
    pub study: Option<&'a Outline>,
    pub command: &'a str,
}

pub(super) fn render(content: &Content<'_>) -> Result<String> {
    let refused = |error: minijinja::Error| Error::Page { reason: format!("{error:#}") };
    let mut environment = Environment::new();
    environment.add_template("page.html", TEMPLATE).map_err(refused)?;
    let page = environment.get_template("page.html").map_err(refused)?;
    let count = |of: &dyn Fn(&Record) -> String| {
        content.records.iter().map(of).collect::<BTreeSet<_>>().len()
    };
    let sections: Vec<Value> = content
        .findings
        .iter()
        .zip(content.figures)
        .map(|(findings, figures)| section(findings, figures))
        .collect();
    let missing: Vec<Value> = content.missing.iter().map(missing).collect();
    let context = json!({
        "title": content.study.map_or("Report", |study| study.name.as_str()),
        "version": env!("CARGO_PKG_VERSION"),
        "runs": content.records.len(),
        "methods": count(&|record| record.variant.clone()),
        "tasks": count(&Record::task_label),
        "seeds": count(&|record| record.seed.to_string()),
        "replicates": grouped(content.options.replicates as u64),
        "confidence": format!("{:.0} %", 100.0 * CONFIDENCE),
        "bootstrap_seed": content.options.seed,
        "command": content.command,
        "study": content.study.map(|study| &study.text),
        "skipped": content.skipped,
        "missing": missing,
        "sections": sections,
        "settings": settings(content.records),
        "commands": commands(content.records),
    });
    page.render(Serde(&context)).map_err(refused)
}

fn section(findings: &Findings<'_>, figures: &[Figure]) -> Value {
    let of = &findings.comparison;
    let kinds: Vec<&str> = findings
        .aggregates
        .first()
        .map_or_else(Vec::new, |(_, list)| list.iter().map(|(kind, _)| *kind).collect());
    let aggregates: Vec<Value> = findings
        .aggregates
        .iter()
        .map(|(variant, estimates)| {
            let cells = estimates.iter().map(|(_, estimate)| written(*estimate, of.suite));
            let cells: Vec<String> = cells.collect();
            json!({ "name": variant, "cells": cells })
        })
        .collect();
    let scores: Vec<Value> = of
        .tasks
        .iter()
        .map(|task| {
            let cell = |variant: &&str| {
                let mut scores = findings.scores.iter();
                let found =
                    scores.find(|score| score.task == task.label && score.variant == *variant);
                found.map_or_else(
                    || "–".to_owned(),
                    |score| match score.runs {
                        1 => format!("{:.1} (1)", score.mean),
                        runs => format!("{:.1} ± {:.1} ({runs})", score.mean, score.deviation),
                    },
                )
            };
            json!({ "name": task.label, "cells": of.variants.iter().map(cell).collect::<Vec<_>>() })
        })
        .collect();
    let figures: Vec<Value> = figures
        .iter()
        .map(|figure| {
            json!({ "name": figure.name, "title": figure.title, "caption": figure.caption, "svg": themed(&figure.svg) })
        })
        .collect();
    json!({
        "title": of.title(),
        "name": of.stem(),
        "kinds": kinds,
        "aggregates": aggregates,
        "scores": scores,
        "figures": figures,
        "variants": of.variants,
        "at": grouped(of.at),
        "unit": of.suite.unit(),
        "common": of.common,
    })
}

fn missing(missing: &Missing) -> Value {
    let seeds: Vec<String> = missing.seeds.iter().map(u64::to_string).collect();
    json!({ "task": missing.task, "method": missing.variant, "seeds": seeds.join(", "), "state": missing.state })
}

/// Full configuration of one run per variant, and the keys in which its other runs differ.
fn settings(records: &[Record]) -> Vec<Value> {
    let mut variants: BTreeMap<&str, Vec<&Record>> = BTreeMap::new();
    for record in records.iter().filter(|record| record.run.is_some()) {
        variants.entry(&record.variant).or_default().push(record);
    }
    let mut all = Vec::new();
    for (variant, records) in variants {
        let mut differing: BTreeMap<String, BTreeMap<String, BTreeSet<String>>> = BTreeMap::new();
        let known = || {
            records
                .iter()
                .filter_map(|record| Some((record, record.run.as_ref()?.settings.as_ref()?)))
        };
        let Some((first, settings)) = known().next() else {
            continue;
        };
        // Compares all runs: even seeds of one task might differ in settings.
        for (record, other) in known() {
            for (key, value) in settings.difference(other) {
                if ["seed", "task", "distractor"].contains(&key) {
                    continue;
                }
                let values = differing.entry(key.to_owned()).or_default();
                values.entry(value.to_owned()).or_default().insert(record.task_label());
            }
        }
        let differing: Vec<Value> = differing
            .into_iter()
            .flat_map(|(key, values)| {
                values.into_iter().map(move |(value, tasks)| {
                    let tasks: Vec<String> = tasks.into_iter().collect();
                    json!({ "key": key, "value": value, "tasks": tasks.join(", ") })
                })
            })
            .collect();
        all.push(json!({ "method": variant, "of": first.cell(), "text": settings.text, "differing": differing }));
    }
    all
}

fn commands(records: &[Record]) -> Vec<Value> {
    let row = |record: &Record| {
        let commands = record.run.as_ref().map(|run| run.commands.clone()).unwrap_or_default();
        json!({
            "task": record.task_label(),
            "method": record.variant,
            "seed": record.seed,
            "origin": record.origin.display().to_string(),
            "commands": commands,
        })
    };
    records.iter().map(row).collect()
}
