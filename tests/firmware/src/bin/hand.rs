//! `condor-hand`: the controller hierarchy of a hand, to the last bit. A hart computes with 64 bits in
//! registers, a Cortex-M4 in software.
#![no_std]
#![no_main]

#[firmware::entry]
fn main() -> ! {
    firmware::check(|checks| {
        hand_exercise::same_bits(&mut |level, found, committed| {
            checks.group(level);
            checks.same(found, Some(committed));
        });
    })
}
