//! Text laid out: JSON with a line for each value of its upper levels, Markdown tables.

use farsight_files::markdown_table;
use serde_json::Value;

/// `value` as JSON: so many outer levels have a line for each of their values, what is within them is on one line. So a
/// diff shows what has changed.
pub(crate) fn laid_out(value: &Value, open_levels: usize) -> String {
    let mut text = String::new();
    lay_out(value, 0, open_levels, &mut text);
    text.push('\n');
    text
}

fn lay_out(value: &Value, level: usize, open_levels: usize, text: &mut String) {
    let (ends, members): ([char; 2], Vec<(String, &Value)>) = match value {
        Value::Object(map) if level < open_levels => {
            (['{', '}'], map.iter().map(|(name, value)| (format!("{}: ", Value::from(name.as_str())), value)).collect())
        }
        Value::Array(values) if level < open_levels => {
            (['[', ']'], values.iter().map(|value| (String::new(), value)).collect())
        }
        _ => return text.push_str(&value.to_string()),
    };
    text.push(ends[0]);
    for (i, (name, member)) in members.iter().enumerate() {
        text.push_str(if i == 0 { "\n" } else { ",\n" });
        text.push_str(&"  ".repeat(level + 1));
        text.push_str(name);
        lay_out(member, level + 1, open_levels, text);
    }
    text.push('\n');
    text.push_str(&"  ".repeat(level));
    text.push(ends[1]);
}

/// A table in Markdown: names on the left, all that stands behind them on the right.
pub(crate) fn table<T: AsRef<str>>(heading: &[T], rows: &[Vec<String>]) -> Vec<String> {
    markdown_table(heading, rows, |column| column > 0)
}
