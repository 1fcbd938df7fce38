//! What the program and the wheel are made of: a list of their crates in the format `CycloneDX` 1.5.

use std::collections::{BTreeMap, BTreeSet};
use std::fs;

use crate::{cargo, root};

/// The list as JSON, of everything that is linked into the program and the wheel's module on this system.
pub(crate) fn cyclone_dx(version: &str) -> Result<String, String> {
    let format = "{p}|{l}";
    let packages = ["--package", "farsight", "--package", "farsight-py"];
    let tree = ["tree", "--locked", "--edges", "normal", "--prefix", "none", "--format", format];
    let output = cargo(None).args(tree).args(packages).output().map_err(|error| format!("cargo tree: {error}"))?;
    if !output.status.success() {
        return Err(format!("cargo tree: {}", String::from_utf8_lossy(&output.stderr)));
    }
    let lock = root().join("Cargo.lock");
    let lock = fs::read_to_string(&lock).map_err(|error| format!("{}: {error}", lock.display()))?;
    Ok(document(version, &String::from_utf8_lossy(&output.stdout), &checksums(&lock)))
}

/// SHA-256 of the crates from the registry, by name and version.
fn checksums(lock: &str) -> BTreeMap<(&str, &str), &str> {
    let mut found = BTreeMap::new();
    for entry in lock.split("[[package]]").skip(1) {
        let value = |key: &str| {
            let line = entry.lines().find_map(|line| line.strip_prefix(key)?.strip_prefix(" = "));
            line.map(|value| value.trim_matches('"'))
        };
        if let (Some(name), Some(version), Some(checksum)) = (value("name"), value("version"), value("checksum")) {
            found.insert((name, version), checksum);
        }
    }
    found
}

/// `tree` has a line `name vVERSION (notes)|licence` for each crate, some more than once.
fn document(version: &str, tree: &str, checksums: &BTreeMap<(&str, &str), &str>) -> String {
    let mut components = BTreeSet::new();
    for line in tree.lines() {
        let Some((package, licence)) = line.split_once('|') else { continue };
        let mut words = package.split_whitespace();
        let (Some(name), Some(number)) = (words.next(), words.next().and_then(|word| word.strip_prefix('v'))) else {
            continue;
        };
        let hashes = checksums.get(&(name, number)).map_or_else(String::new, |sum| {
            format!(", \"hashes\": [{{\"alg\": \"SHA-256\", \"content\": {}}}]", quoted(sum))
        });
        let licences = if licence.is_empty() {
            String::new()
        } else {
            format!(
                ", \"licenses\": [{{\"expression\": {}}}]",
                quoted(&licence.replace(" (*)", "").replace('/', " OR "))
            )
        };
        components.insert(format!(
            "    {{\"type\": \"library\", \"name\": {}, \"version\": {}, \"purl\": {}{hashes}{licences}}}",
            quoted(name),
            quoted(number),
            quoted(&format!("pkg:cargo/{name}@{number}"))
        ));
    }
    let components: Vec<String> = components.into_iter().collect();
    format!(
        "{{\n  \"bomFormat\": \"CycloneDX\",\n  \"specVersion\": \"1.5\",\n  \"version\": 1,\n  \"metadata\": {{\"component\": \
         {{\"type\": \"application\", \"name\": \"farsight\", \"version\": {}}}}},\n  \"components\": [\n{}\n  ]\n}}\n",
        quoted(version),
        components.join(",\n")
    )
}

/// A JSON string; names and licences have no control characters.
fn quoted(text: &str) -> String {
    format!("\"{}\"", text.replace('\\', "\\\\").replace('"', "\\\""))
}

#[cfg(test)]
mod tests {
    use super::{checksums, cyclone_dx, document};

    #[test]
    fn what_is_in_the_program_and_what_is_in_the_wheel_are_listed() {
        let text = cyclone_dx("0.1.0").unwrap();
        for name in ["farsight", "farsight-py", "clap", "pyo3", "rten", "farsight-weights-w", "farsight-weights-n"] {
            assert!(text.contains(&format!("\"type\": \"library\", \"name\": \"{name}\"")), "no {name}");
        }
        // Of the wheel's build, not in it; and libtorch is for training.
        assert!(!text.contains("\"name\": \"pyo3-build-config\"") && !text.contains("\"name\": \"tch\""));
    }

    #[test]
    fn crates_are_listed_once_with_hash_and_licence() {
        let lock = "version = 4\n\n[[package]]\nname = \"a\"\nversion = \"1.0.0\"\nchecksum = \"ab12\"\n\n[[package]]\nname = \"own\"\nversion = \"0.1.0\"\n";
        let tree = "own v0.1.0 (/home/me)|MIT\na v1.0.0|MIT/Apache-2.0\na v1.0.0|MIT/Apache-2.0 (*)\n\n";
        let text = document("0.1.0", tree, &checksums(lock));
        assert_eq!(text.matches("pkg:cargo/a@1.0.0").count(), 1, "{text}");
        assert!(text.contains(r#""hashes": [{"alg": "SHA-256", "content": "ab12"}], "licenses": [{"expression": "MIT OR Apache-2.0"}]"#), "{text}");
        assert!(text.contains(r#""name": "own", "version": "0.1.0""#) && !text.contains("/home/me"), "{text}");
    }
}
