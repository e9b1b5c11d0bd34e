//! Random systems do by the page what the reference says.

use proptest::test_runner::{Config, TestRunner};

use crate::system::systems;
use crate::{page, reference};

/// How many systems there are without `PROPTEST_CASES`. A hundred thousand:
/// `PROPTEST_CASES=100000 cargo test --release -p condor-clock --features linux --test clock`.
const SYSTEMS: u32 = 5000;

#[test]
fn all_events_are_in_the_order_of_the_reference() {
    let mut config = Config {
        source_file: Some(file!()),
        ..Config::default()
    };
    if std::env::var_os("PROPTEST_CASES").is_none() {
        config.cases = SYSTEMS;
    }
    let mut runner = TestRunner::new(config);
    runner
        .run(&systems(), |system| {
            let events = page::run(&system);
            assert_eq!(events, reference::run(&system));
            Ok(())
        })
        .unwrap();
}
