use crate::Result;
use crate::command::Line;
use crate::context::Context;
use crate::parts::Summary;
use crate::tests_run;
use crate::tools::need_component;

/// The tests of one package that Miri runs: its unit tests, and the named modules of its test program.
struct Suite {
    package: &'static str,
    features: &'static str,
    /// True if it has unit tests.
    units: bool,
    /// The test program, without which there are no modules.
    program: &'static str,
    /// The modules that make no system call that Miri lacks, and end within a minute in it.
    modules: &'static [&'static str],
    /// Tests of many thousand cases, which only `test` makes, by a part of their names.
    skipped: &'static [&'static str],
}

/// The longest first, since two run at a time.
const SUITES: [Suite; 8] = [
    Suite {
        package: "condor-mos",
        features: "sim",
        units: true,
        program: "mos",
        modules: &["scope::", "latest::"],
        skipped: &["interrupted::", "the_largest_numbers_end"],
    },
    Suite {
        package: "condor-dev",
        features: "sim,conformance",
        units: true,
        program: "dev",
        modules: &["switch::", "controllers_conform::"],
        skipped: &["interrupted::drivers"],
    },
    Suite {
        package: "condor-hand",
        features: "sim",
        units: true,
        program: "hand",
        modules: &[],
        skipped: &["noise_is_centred", "states_never_become_denormal"],
    },
    Suite {
        package: "condor-mbox",
        features: "sim",
        units: true,
        program: "mbox",
        modules: &["conformance::"],
        skipped: &[],
    },
    Suite {
        package: "condor-clock",
        features: "std",
        units: true,
        program: "clock",
        modules: &[],
        skipped: &[],
    },
    Suite {
        package: "condor-tty",
        features: "hostile",
        units: false,
        program: "tty",
        modules: &["cooked::"],
        skipped: &["lines_are_edited", "raw_mode_gives_every_character"],
    },
    Suite {
        package: "condor-vars",
        features: "hostile",
        units: true,
        program: "vars",
        modules: &["hostile::"],
        skipped: &[],
    },
    Suite {
        package: "condor-fs",
        features: "hostile",
        units: true,
        program: "fs",
        modules: &["settle::"],
        skipped: &["server::"],
    },
];

/// proptest asks for its directory and reads its number of cases from the environment.
const FLAGS: &str = "-Zmiri-strict-provenance -Zmiri-disable-isolation";

/// Miri is some hundred times slower than the machine; `test` makes the many cases.
const PROPTEST_CASES: &str = "4";

pub(crate) fn run(context: &Context) -> Result<Summary> {
    need_component(context, Some("nightly"), "miri")?;
    need_component(context, Some("nightly"), "rust-src")?;
    // Miri interprets on one core.
    let mut lines = Vec::new();
    for suite in &SUITES {
        if suite.units {
            lines.push(tests(context, suite, "--lib", &[]));
        }
        if !suite.modules.is_empty() {
            let program = format!("--test {}", suite.program);
            lines.push(tests(context, suite, &program, suite.modules));
        }
    }
    let passed = tests_run::count_together(&lines)?;
    Ok(Summary::of(format!("{passed} tests")))
}

fn tests(context: &Context, suite: &Suite, what: &str, modules: &[&str]) -> Line {
    let mut line = format!(
        "cargo +nightly miri test -p {} --features {} {what} --",
        suite.package, suite.features
    );
    for module in modules {
        line += " ";
        line += module;
    }
    for test in suite.skipped {
        line += " --skip ";
        line += test;
    }
    context
        .command(&line)
        .env("MIRIFLAGS", FLAGS)
        .env("PROPTEST_CASES", PROPTEST_CASES)
}
