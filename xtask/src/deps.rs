//! Dependencies between modules, read from the code.
//!
//! A module may use only modules above it in the table of `src/lib.rs`, and the base modules.

use crate::cycles;
use anyhow::{Context, Result, ensure};
use regex::Regex;
use std::collections::{BTreeMap, BTreeSet};
use std::fs;
use std::path::Path;

/// Base modules, which all others may use; each uses only those before it.
const BASE: [&str; 6] = ["error", "work", "interrupt", "memory", "parallel", "registers"];

/// Prints the dependencies of all modules and fails if one points downwards or files depend on each other cyclically.
pub fn check(root: &Path) -> Result<()> {
    let source = root.join("src");
    let order = order(&fs::read_to_string(source.join("lib.rs"))?)?;
    let mut modules = BTreeMap::new();
    for module in &order {
        let mut files = Vec::new();
        if source.join(module).is_dir() {
            cycles::collect(&source.join(module), &mut files)?;
        }
        let file = source.join(module).with_extension("rs");
        files.extend(file.exists().then_some(file));
        ensure!(!files.is_empty(), "src/lib.rs lists {module}, which is no module");
        let mut used = BTreeSet::new();
        for file in files {
            used.extend(uses(&fs::read_to_string(&file).with_context(|| file.display().to_string())?)?);
        }
        used.remove(module);
        modules.insert(module.clone(), used);
    }
    print!("{}", picture(&order, &modules));
    let wrong = upward(&order, &modules);
    ensure!(wrong.is_empty(), "modules that use modules below them: {}", wrong.join(", "));
    println!("{} modules; each uses only modules above it", order.len());
    let sources = ["src", "xtask/src", "python/src", "distributed/src", "benches/peers/src"];
    for source in sources {
        let cycles = cycles::find(&root.join(source))?;
        let shown: Vec<String> = cycles.iter().map(|cycle| cycle.join(", ")).collect();
        ensure!(shown.is_empty(), "cyclic dependencies between files of {source}: {}", shown.join("; "));
    }
    println!("no cyclic dependencies between the files of {}", sources.join(", "));
    Ok(())
}

/// The modules in order: base modules, then those of the table.
fn order(library: &str) -> Result<Vec<String>> {
    let row = Regex::new(r"(?m)^//! \| \[`([a-z_]+)`\]")?;
    let listed = row.captures_iter(library).map(|found| found[1].to_owned());
    Ok(BASE.into_iter().map(str::to_owned).chain(listed).collect())
}

/// The modules that the code of a file uses, without its documentation and tests.
fn uses(code: &str) -> Result<BTreeSet<String>> {
    let path = Regex::new(r"\bcrate::(?:\{([^}]*)\}|([a-z_]+))")?;
    let code = code.split("#[cfg(test)]\nmod tests {").next().unwrap_or_default();
    let code = code.split("#[cfg(all(test, feature = \"scene\"))]\nmod tests {").next().unwrap_or_default();
    let lines = code.lines().filter(|line| !line.trim_start().starts_with("//")).collect::<Vec<_>>().join("\n");
    let mut used = BTreeSet::new();
    for found in path.captures_iter(&lines) {
        match (found.get(1), found.get(2)) {
            (Some(list), _) => {
                let names = list.as_str().split(',').filter_map(|item| item.trim().split("::").next());
                used.extend(names.map(str::to_owned));
            }
            (_, Some(name)) => _ = used.insert(name.as_str().to_owned()),
            _ => {}
        }
    }
    Ok(used)
}

/// Dependencies of a module on one below it.
fn upward(order: &[String], modules: &BTreeMap<String, BTreeSet<String>>) -> Vec<String> {
    let place = |name: &String| order.iter().position(|other| other == name);
    let mut wrong = Vec::new();
    for (module, used) in modules {
        let below = used.iter().filter(|other| place(other).is_some_and(|at| Some(at) > place(module)));
        wrong.extend(below.map(|other| format!("{module} → {other}")));
    }
    wrong
}

/// One line for each module: its layer, and the modules that it uses besides the base modules.
fn picture(order: &[String], modules: &BTreeMap<String, BTreeSet<String>>) -> String {
    let mut layers: BTreeMap<&str, usize> = BTreeMap::new();
    let mut text = String::new();
    for module in order {
        let used = modules.get(module).into_iter().flatten();
        let known: Vec<&str> = used.map(String::as_str).filter(|name| order.iter().any(|m| m == name)).collect();
        let layer = known.iter().filter_map(|name| layers.get(name)).max().map_or(0, |highest| highest + 1);
        layers.insert(module, layer);
        let shown: Vec<&str> = known.into_iter().filter(|name| !BASE.contains(name)).collect();
        text += &format!("{layer:2}  {module:<11}{}\n", shown.join(" "));
    }
    text
}

#[cfg(test)]
mod tests {
    use super::{check, order, upward, uses};
    use std::collections::{BTreeMap, BTreeSet};

    #[test]
    fn modules_use_only_modules_above_them() {
        check(&crate::root().unwrap()).unwrap();
    }

    #[test]
    fn uses_are_those_of_the_code_alone() {
        let code = "//! [`x`](crate::doc)\nuse crate::{force::F, work};\nfn f() { crate::spring::g() }\n\
                    #[cfg(test)]\nmod tests {\n    use crate::scene::S;\n}\n";
        let expected = ["force", "spring", "work"].map(str::to_owned);
        assert_eq!(uses(code).unwrap(), BTreeSet::from(expected));
    }

    #[test]
    fn dependencies_on_modules_below_are_found() {
        let listed = order("//! | [`a`] | x |\n//! | [`b`] | y |\n").unwrap();
        let uses = |name: &str| BTreeSet::from([name.to_owned()]);
        let modules = BTreeMap::from([("a".to_owned(), uses("b")), ("b".to_owned(), uses("error"))]);
        assert_eq!(upward(&listed, &modules), ["a → b"]);
    }
}
