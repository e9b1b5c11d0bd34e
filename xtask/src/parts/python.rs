//! The Python package: built, installed as a person does, checked by a type checker and by its tests.

use std::env;

use crate::Result;
use crate::context::Context;
use crate::parts::Summary;
use crate::parts::test;
use crate::tools::need_python;

/// The folder of its Python.
const PLACE: &str = "target/python";

pub(crate) fn run(context: &Context) -> Result<Summary> {
    let packages = "maturin==1.16.0 mypy==2.4.1 numpy==2.4.6 eclipse-zenoh==1.10.2 matplotlib==3.11.2 mujoco==4.0.0";
    let python = need_python(context, PLACE, packages)?;
    test::build(context)?;
    let target = context.target()?;
    let path = env::var("PATH").unwrap_or_default();
    // With what is installed above, and what is compiled already: unoptimized.
    let install = format!(
        "{python} -m pip install --quiet --disable-pip-version-check --no-build-isolation \
         --force-reinstall --no-deps ./system/python"
    );
    context
        .command(&install)
        .env(
            "PATH",
            format!("{}/{PLACE}/bin:{path}", context.root.display()),
        )
        .env("CARGO_TARGET_DIR", target.to_string_lossy())
        .env("MATURIN_PEP517_ARGS", "--profile dev")
        .run()?;
    let types = format!(
        "../../{python} -m mypy --strict --cache-dir ../../{PLACE}/mypy python/condor tests"
    );
    context.command(&types).dir("system/python").run()?;
    let line = format!("{python} system/python/tests/all.py");
    let kept = context
        .command(&line)
        .env("PYTHONDONTWRITEBYTECODE", "1")
        .env(
            "UTAH_MIT_HAND",
            target.join("debug/utah-mit-hand").to_string_lossy(),
        )
        .kept()?;
    Ok(Summary::of(format!(
        "{kept} tests in Python, and its types"
    )))
}
