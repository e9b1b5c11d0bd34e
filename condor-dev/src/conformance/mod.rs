//! The suites that a backend of one's own calls from one test, or from a firmware.
