//! The suites that a backend of ones own calls from one test.
