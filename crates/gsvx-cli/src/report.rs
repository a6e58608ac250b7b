//! What a command says when it is done: lines for a person, or one JSON object.

use serde_json::Value;
use std::io::Write;

/// Where reports go.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Reporter {
    pub(crate) json: bool,
}

impl Reporter {
    /// Prints the report: to standard output, or to standard error where that holds the data.
    pub(crate) fn say(self, stdout_taken: bool, human: &str, json: &Value) {
        let text = if self.json { json.to_string() } else { human.to_owned() };
        // A reader that has closed the pipe has seen enough; the work is done.
        if stdout_taken {
            let _ = writeln!(std::io::stderr(), "{text}");
        } else {
            let _ = writeln!(std::io::stdout(), "{text}");
        }
    }
}
