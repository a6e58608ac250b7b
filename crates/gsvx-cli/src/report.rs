//! What a command says when it is done: lines for a person, or one JSON object.

use crate::output::Written;
use anyhow::{Context, Result};
use serde_json::Value;
use std::io::{ErrorKind, Write};

/// Where reports go.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Reporter {
    pub(crate) json: bool,
}

impl Reporter {
    /// Prints the report: to standard output, or to standard error where that holds the data.
    ///
    /// # Errors
    /// If it cannot be written. A reader that has closed the pipe has seen enough: the work is
    /// done, and that is no error.
    pub(crate) fn say(self, stdout_taken: bool, human: &str, json: &Value) -> Result<()> {
        let text = if self.json { json.to_string() } else { gs_model::printable(human) };
        let mut out: Box<dyn Write> = match stdout_taken {
            true => Box::new(std::io::stderr()),
            false => Box::new(std::io::stdout()),
        };
        match writeln!(out, "{text}").and_then(|()| out.flush()) {
            Err(e) if e.kind() != ErrorKind::BrokenPipe => {
                Err(e).context("the report could not be written")
            }
            _ => Ok(()),
        }
    }

    /// Prints the report of an output.
    pub(crate) fn wrote(self, output: &Written, human: &str, mut json: Value) -> Result<()> {
        json["output"] = output.name.as_str().into();
        self.say(output.stdout, &format!("{}: {human}", output.name), &json)
    }
}
