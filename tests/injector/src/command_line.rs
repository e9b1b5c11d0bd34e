use std::str::FromStr;
use std::time::SystemTime;

/// Returns the value that follows `name` on the command line of a test program, or `usual`. All other
/// arguments, which are libtest's, count for nothing.
///
/// # Errors
/// Returns the parse error of `T` if the value is missing or is not a `T`.
pub fn argument<T: FromStr>(name: &str, usual: T) -> Result<T, T::Err> {
    let mut arguments = std::env::args().skip_while(|argument| argument != name);
    match arguments.next() {
        None => Ok(usual),
        Some(_) => arguments.next().unwrap_or_default().parse(),
    }
}

/// Returns the value of `--seed`, or another number each time; prints it.
///
/// # Errors
/// Returns the parse error if the value is missing or is not a number.
pub fn seed() -> Result<u64, std::num::ParseIntError> {
    let since = SystemTime::now().duration_since(SystemTime::UNIX_EPOCH);
    let seed = argument("--seed", since.unwrap_or_default().subsec_nanos().into())?;
    println!("seed {seed} (repeat with --seed)");
    Ok(seed)
}
