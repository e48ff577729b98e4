//! Paths and commands that the documents name exist, and lock files are whole.

use std::path::Path;

const ROOT: &str = concat!(env!("CARGO_MANIFEST_DIR"), "/../..");

/// Words in backticks that are paths of this project: with a slash and no space, placeholder or
/// option.
fn paths(text: &str) -> impl Iterator<Item = &str> {
    let spans = text.split('`').skip(1).step_by(2);
    spans.filter(|span| {
        let first = span.split('/').next().unwrap_or_default();
        let ours = ["apps", "crates", "tests", "benches", "docs", "examples", ".ci"];
        span.contains('/') && ours.contains(&first) && !span.contains([' ', '<', '*'])
    })
}

fn read(name: &str) -> String {
    std::fs::read_to_string(Path::new(ROOT).join(name)).unwrap()
}

/// The documents that are written by hand, as paths from the root.
fn documents() -> Vec<String> {
    let mut names: Vec<String> = ["README.md", "ARCHITECTURE.md", "CONTRIBUTING.md"].map(String::from).into();
    let guide = std::fs::read_dir(Path::new(ROOT).join("docs/guide")).unwrap();
    let guide = guide.map(|entry| entry.unwrap().file_name().into_string().unwrap());
    names.extend(guide.filter(|name| name.ends_with(".md")).map(|name| format!("docs/guide/{name}")));
    names
}

#[test]
fn named_paths_exist() {
    let mut named = 0;
    for document in documents() {
        let text = read(&document);
        // Blocks of code hold commands, not paths of this project.
        let prose: String = text.split("```").step_by(2).collect();
        for path in paths(&prose) {
            assert!(Path::new(ROOT).join(path).exists(), "{document} names {path}, which does not exist");
            named += 1;
        }
    }
    assert!(named > 25, "only {named} paths found: are they still in backticks?");
}

#[test]
fn links_lead_somewhere() {
    for document in documents() {
        let text = read(&document);
        let folder = Path::new(ROOT).join(&document).parent().unwrap().to_owned();
        for target in text.split("](").skip(1).filter_map(|rest| rest.split(')').next()) {
            if !target.starts_with("http") && !target.starts_with('#') {
                let file = target.split('#').next().unwrap_or_default();
                assert!(folder.join(file).exists(), "{document} links to {target}");
            }
        }
    }
}

#[test]
fn the_readme_links_to_every_page_of_the_guide() {
    let readme = read("README.md");
    for page in documents().iter().filter(|name| name.starts_with("docs/guide/")) {
        assert!(readme.contains(&format!("]({page})")), "README.md does not link to {page}");
    }
}

#[test]
fn readme_and_ci_run_the_same_tests() {
    assert!(read("README.md").contains("\ncargo test --workspace\n"));
    assert!(read(".ci/run").contains("\ncargo test --workspace\n"));
}

#[test]
fn the_crate_outside_of_the_workspace_locks_what_the_libraries_depend_on() {
    let lock: toml::Table = read("tests/downstream/Cargo.lock").parse().unwrap();
    let locked: Vec<&str> =
        lock["package"].as_array().unwrap().iter().map(|package| package["name"].as_str().unwrap()).collect();
    // The same versions, or dependencies would be built twice.
    let here = read("Cargo.lock");
    for package in lock["package"].as_array().unwrap().iter().filter(|one| one.get("source").is_some()) {
        let [name, version] = ["name", "version"].map(|key| package[key].as_str().unwrap());
        assert!(
            here.contains(&format!("name = \"{name}\"\nversion = \"{version}\"\n")),
            "{name} {version} is not in Cargo.lock: copy Cargo.lock into tests/downstream and run \
             `cargo tree --manifest-path tests/downstream/Cargo.toml`"
        );
    }
    for library in std::fs::read_dir(Path::new(ROOT).join("crates")).unwrap() {
        let path = library.unwrap().path().join("Cargo.toml");
        let manifest: toml::Table = std::fs::read_to_string(&path).unwrap().parse().unwrap();
        if !locked.contains(&manifest["package"]["name"].as_str().unwrap()) {
            continue;
        }
        // The crate asks for no features, so what is optional is not locked.
        let is_optional =
            |details: &toml::Value| details.get("optional").is_some_and(|v| v.as_bool() == Some(true));
        let dependencies = manifest["dependencies"].as_table().unwrap();
        for (name, _) in dependencies.iter().filter(|(_, details)| !is_optional(details)) {
            assert!(
                locked.contains(&name.as_str()),
                "{} depends on {name}: run `cargo update --workspace --manifest-path tests/downstream/Cargo.toml`",
                path.display()
            );
        }
    }
}
