//! README.md says what is true, where no compiler looks.

#[test]
fn the_excerpt_for_linux_is_tested_in_its_module() {
    let readme = include_str!("../../README.md");
    let module = include_str!("../../src/linux/mod.rs");
    let (_, excerpt) = readme.split_once("```rust,ignore\n").unwrap();
    let (excerpt, _) = excerpt.split_once("```").unwrap();
    let mut rest = module;
    for line in excerpt.lines().filter(|line| !line.is_empty()) {
        (_, rest) = rest.split_once(&format!("//! {line}\n")).expect(line);
    }
}
