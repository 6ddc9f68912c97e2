//! Calls of Slurm's programs. Output in any unexpected form counts as an error, so that no run is submitted twice.

use std::fmt;
use std::io::ErrorKind;
use std::path::Path;
use std::process::Command;

/// Largest array if Slurm does not report its limit: one less than the default of `MaxArraySize`, 1001.
const LARGEST_ARRAY: usize = 1000;

/// Job of a submission, as saved in its folder.
pub(super) enum Number {
    /// Not saved.
    None,
    /// A job.
    Noted(Submitted),
    /// Text that is no job.
    Unreadable(String),
}

/// A submitted job array.
#[derive(Debug, Clone, PartialEq, Eq)]
pub(super) struct Submitted {
    /// Job number of the array.
    pub number: String,
    /// Its cluster, if Slurm manages several.
    pub cluster: Option<String>,
}

impl Submitted {
    /// Parses the last line of the form `NUMBER` or `NUMBER;CLUSTER`, because sbatch may print notices of the site
    /// before it.
    pub(super) fn parse(text: &str) -> Option<Self> {
        text.lines().rev().find_map(|line| {
            let (number, cluster) = match line.trim().split_once(';') {
                Some((number, cluster)) => (number, Some(cluster)),
                None => (line.trim(), None),
            };
            let is_number = !number.is_empty() && number.bytes().all(|byte| byte.is_ascii_digit());
            let is_name = |name: &str| !name.is_empty() && !name.contains([' ', '\t', ';']);
            (is_number && cluster.is_none_or(is_name))
                .then(|| Self { number: number.to_owned(), cluster: cluster.map(str::to_owned) })
        })
    }
}

impl fmt::Display for Submitted {
    fn fmt(&self, formatter: &mut fmt::Formatter<'_>) -> fmt::Result {
        match &self.cluster {
            Some(cluster) => write!(formatter, "{};{cluster}", self.number),
            None => formatter.write_str(&self.number),
        }
    }
}

/// Output of a program, and its exit status if it failed.
struct Answer {
    out: String,
    err: String,
    failed: Option<String>,
}

impl Answer {
    /// Both output streams, for messages.
    fn words(&self) -> String {
        let parts = [self.out.trim(), self.err.trim()];
        let said: Vec<&str> = parts.into_iter().filter(|part| !part.is_empty()).collect();
        if said.is_empty() { "nothing".to_owned() } else { format!("{:?}", said.join("\n")) }
    }
}

fn run(program: &str, arguments: &[&str]) -> std::io::Result<Answer> {
    let mut command = Command::new(program);
    command.args(arguments);
    // The user's squeue defaults may hide jobs or list finished ones.
    let of_squeue = std::env::vars_os().map(|(name, _)| name);
    for name in of_squeue.filter(|name| name.to_string_lossy().starts_with("SQUEUE_")) {
        command.env_remove(name);
    }
    // This variable would override the script's array.
    command.env_remove("SBATCH_ARRAY_INX");
    let output = command.output()?;
    Ok(Answer {
        out: String::from_utf8_lossy(&output.stdout).into_owned(),
        err: String::from_utf8_lossy(&output.stderr).into_owned(),
        failed: (!output.status.success()).then(|| output.status.to_string()),
    })
}

/// Submits a script with sbatch.
pub(super) fn sbatch(script: &Path, after: Option<&str>) -> Result<Submitted, String> {
    let script = script.to_string_lossy();
    let dependency = after.map(|job| {
        let number = job.split(';').next().unwrap_or_default();
        format!("--dependency=afterany:{number}")
    });
    let arguments: Vec<&str> =
        ["--parsable"].into_iter().chain(dependency.as_deref()).chain([&*script]).collect();
    let answer =
        run("sbatch", &arguments).map_err(|error| format!("cannot run sbatch: {error}"))?;
    if let Some(status) = &answer.failed {
        return Err(format!("sbatch ended with {status} and printed {}", answer.words()));
    }
    Submitted::parse(&answer.out).ok_or_else(|| {
        format!(
            "expected a job number from sbatch, as in 4242 or 4242;CLUSTER, but it printed {}",
            answer.words()
        )
    })
}

/// Indices of an array's jobs that are still in the queue; empty if Slurm does not know the job.
pub(super) fn indices_of(submitted: &Submitted) -> Result<Vec<usize>, String> {
    let cluster = submitted.cluster.as_ref().map(|cluster| format!("--clusters={cluster}"));
    let fixed = ["--noheader", "--array", "--format=%K", "--jobs", &submitted.number];
    let arguments: Vec<&str> = cluster.as_deref().into_iter().chain(fixed).collect();
    let answer =
        run("squeue", &arguments).map_err(|error| format!("cannot run squeue: {error}"))?;
    if let Some(status) = &answer.failed {
        if answer.err.to_lowercase().contains("invalid job id specified") {
            return Ok(Vec::new());
        }
        return Err(format!(
            "squeue for job {submitted} ended with {status} and printed {}",
            answer.words()
        ));
    }
    let lines = lines(&answer.out).map(|line| line.parse::<usize>());
    lines.collect::<Result<_, _>>().map_err(|_| {
        format!(
            "expected array indices of job {submitted} from squeue, but it printed {}",
            answer.words()
        )
    })
}

/// Finds the job of a script and the indices of its array that are still in the queue. Without squeue returns `None`,
/// because nothing was submitted from this machine.
pub(super) fn job_of(
    script: &Path,
    study: &str,
) -> Result<Option<(Submitted, Vec<usize>)>, String> {
    let name = format!("--name={}", super::script::job_name(study));
    let answer = match run("squeue", &["--noheader", "--array", &name, "--format=%F %K %o"]) {
        Err(error) if error.kind() == ErrorKind::NotFound => return Ok(None),
        answer => answer.map_err(|error| format!("cannot run squeue: {error}"))?,
    };
    if let Some(status) = &answer.failed {
        return Err(format!("squeue ended with {status} and printed {}", answer.words()));
    }
    let mut found: Option<(Submitted, Vec<usize>)> = None;
    for line in lines(&answer.out) {
        let mut parts = line.splitn(3, ' ');
        let (number, index, command) = (parts.next(), parts.next(), parts.next());
        let (Some(number), Some(index), Some(command)) = (number, index, command) else {
            return Err(format!(
                "expected a list of jobs from squeue, but it printed {}",
                answer.words()
            ));
        };
        if Path::new(command) != script {
            continue;
        }
        let (Some(submitted), Ok(index)) = (Submitted::parse(number), index.parse()) else {
            return Err(format!("expected jobs of an array from squeue, but it printed {line:?}"));
        };
        match &mut found {
            Some((first, indices)) if *first == submitted => indices.push(index),
            // Submitted twice by hand: both arrays have the same runs.
            Some((_, indices)) => indices.push(index),
            None => found = Some((submitted, vec![index])),
        }
    }
    Ok(found)
}

/// Rows of squeue's output, without the line that names the cluster.
fn lines(text: &str) -> impl Iterator<Item = &str> {
    text.lines().map(str::trim).filter(|line| !line.is_empty() && !line.starts_with("CLUSTER: "))
}

/// Largest number of jobs in an array.
pub(super) fn largest_array() -> usize {
    let answer = run("scontrol", &["show", "config"]).ok().filter(|answer| answer.failed.is_none());
    answer.and_then(|answer| max_array_size(&answer.out)).unwrap_or(LARGEST_ARRAY)
}

/// Parses `MaxArraySize`, which is one more than the largest index and thus the largest number of jobs, from index 0.
fn max_array_size(configuration: &str) -> Option<usize> {
    configuration.lines().find_map(|line| {
        let (name, value) = line.split_once('=')?;
        (name.trim() == "MaxArraySize").then(|| value.trim().parse().ok())?
    })
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_job_number_is_the_last_line_that_is_one() {
        let parsed = |text: &str| Submitted::parse(text).map(|of| (of.number, of.cluster));
        let of = |number: &str, cluster: Option<&str>| {
            Some((number.to_owned(), cluster.map(str::to_owned)))
        };
        assert_eq!(parsed("4242\n"), of("4242", None));
        assert_eq!(parsed("Notice: maintenance at 17\n4242;c1\n"), of("4242", Some("c1")));
        assert_eq!(parsed("17\r\n4242;c1\r\nHave a nice day\r\n"), of("4242", Some("c1")));
        for text in ["", "job 4242", "4242 submitted", "4242;", ";c1", "-1", "42.5", "4242;c 1"] {
            assert_eq!(parsed(text), None, "{text}");
        }
    }

    #[test]
    fn the_limit_is_read_where_it_is_told() {
        let text = "MailProg                = /bin/mail\nMaxArraySize            = 1001\n";
        assert_eq!(max_array_size(text), Some(1001));
        assert_eq!(max_array_size("MaxArraySize = (null)\n"), None);
        assert_eq!(max_array_size(""), None);
    }
}
