//! `RESULTS.md`: what the sub-commands found last, a section for each.

use std::fmt::Display;
use std::fs;
use std::process::Command;

use crate::Result;

const FILE: &str = concat!(env!("CARGO_MANIFEST_DIR"), "/RESULTS.md");
const HEADING: &str = "\n## ";
/// The line above the remarks of people, which stay when the figures are replaced.
const REMARKS: &str = "<!-- remarks -->\n";

/// Puts a report into the section of a sub-command, in the place of the one before.
pub(crate) fn record(name: &str, about: &str, header: &str, report: &impl Display) -> Result<()> {
    let date = Command::new("date").args(["-u", "+%F"]).output()?;
    let date = String::from_utf8(date.stdout)?;
    let figures = format!(
        "{about}\n\n```text\ndate:    {date}{header}\n{}\n```\n\n",
        report.to_string().trim_end()
    );
    let text = fs::read_to_string(FILE)?;
    fs::write(FILE, replaced(&text, name, &figures))?;
    Ok(())
}

/// Returns the text with other figures in a section, which is added at the end if there is none.
fn replaced(text: &str, name: &str, figures: &str) -> String {
    let heading = format!("{HEADING}{name}\n\n");
    let (before, rest) = text.split_once(&heading).unwrap_or((text, ""));
    let (section, after) = match rest.find(HEADING) {
        Some(end) => rest.split_at(end),
        None => (rest, ""),
    };
    let remarks = section
        .split_once(REMARKS)
        .map_or("", |(_, remarks)| remarks);
    format!("{before}{heading}{figures}{REMARKS}{remarks}{after}")
}

#[cfg(test)]
mod tests {
    use super::replaced;

    #[test]
    fn a_section_is_replaced_and_its_remarks_stay() {
        let text = "# Results\n";
        let text = replaced(text, "a", "1\n\n");
        let text = replaced(&text, "ab", "2\n\n");
        let text = text.replace("2\n\n<!-- remarks -->\n", "2\n\n<!-- remarks -->\nWhy.\n");
        let text = text.replace("1\n\n<!-- remarks -->\n", "1\n\n<!-- remarks -->\nSo.\n");
        let text = replaced(&text, "a", "3\n\n");
        assert_eq!(
            text,
            "# Results\n\n## a\n\n3\n\n<!-- remarks -->\nSo.\n\n## ab\n\n2\n\n<!-- remarks -->\nWhy.\n"
        );
    }
}
