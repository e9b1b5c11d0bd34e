//! The place where a step of one instruction ends.
//!
//! Source: RISC-V Instruction Set Manual, volume I, RV64I 2.1, "A" 2.1 and "C" 2.0.

/// The most instructions of a sequence that begins with `lr`; the manual allows 16 that are sure to succeed.
const LONGEST: usize = 32;

/// The bits of `word` from `from` on, `count` of them, at `to` of the result.
const fn bits(word: u32, from: u32, count: u32, to: u32) -> u32 {
    (word >> from & ((1 << count) - 1)) << to
}

/// An offset whose sign is bit `sign`.
const fn offset(word: u32, sign: u32) -> u64 {
    let unused = 31 - sign;
    (((word << unused).cast_signed() >> unused) as i64).cast_unsigned()
}

/// Returns the addresses at which a step from `pc` may end. `fetch` reads the instruction at an address, of
/// which the upper half is unused if it has 16 bits, and `x` an integer register.
///
/// A sequence from `lr` to `sc` is one step, since no trap may come between them: it ends behind `sc`, or where
/// a branch leads out of it.
pub(super) fn ends<E>(
    pc: u64,
    fetch: impl Fn(u64) -> Result<Option<u32>, E>,
    x: impl Fn(u32) -> Result<u64, E>,
) -> Result<Vec<u64>, E> {
    let Some(word) = fetch(pc)? else {
        return Ok(Vec::new());
    };
    if is_atomic(word, LR)
        && let Some(ends) = sequence(pc, fetch)?
    {
        return Ok(ends);
    }
    Ok(vec![next(pc, word, x)?])
}

/// The function codes that `is_atomic` compares.
const LR: u32 = 0b00010;
const SC: u32 = 0b00011;

/// Whether `word` is the atomic instruction of this function, the bits from 27 on.
const fn is_atomic(word: u32, function: u32) -> bool {
    word & 0x7f == 0x2f && word >> 27 == function
}

/// The ends of the sequence whose `lr` is at `pc`; `None` if it is none.
fn sequence<E>(
    pc: u64,
    fetch: impl Fn(u64) -> Result<Option<u32>, E>,
) -> Result<Option<Vec<u64>>, E> {
    let (mut at, mut ends) = (pc.wrapping_add(4), Vec::new());
    for _ in 0..LONGEST {
        let Some(word) = fetch(at)? else {
            break;
        };
        let (bytes, leads) = match (word & 3, word & 0x7f, bits(word, 13, 3, 0)) {
            (3, 0x63, _) => (4, Some(branch(word))),
            (3, 0x6f | 0x67 | 0x73, _) | (1, _, 5) => break,
            (3, ..) => (4, None),
            (1, _, 6 | 7) => (2, Some(compressed_branch(word))),
            (2, _, 4) if bits(word, 2, 5, 0) == 0 => break,
            _ => (2, None),
        };
        ends.extend(leads.map(|offset| at.wrapping_add(offset)));
        at = at.wrapping_add(bytes);
        if is_atomic(word, SC) {
            ends.retain(|end| !(pc..at).contains(end));
            ends.push(at);
            return Ok(Some(ends));
        }
    }
    Ok(None)
}

/// The offset of a conditional branch.
const fn branch(word: u32) -> u64 {
    let to =
        bits(word, 31, 1, 12) | bits(word, 7, 1, 11) | bits(word, 25, 6, 5) | bits(word, 8, 4, 1);
    offset(to, 12)
}

/// The same of `c.beqz` and `c.bnez`.
const fn compressed_branch(word: u32) -> u64 {
    let to = bits(word, 12, 1, 8)
        | bits(word, 5, 2, 6)
        | bits(word, 2, 1, 5)
        | bits(word, 10, 2, 3)
        | bits(word, 3, 2, 1);
    offset(to, 8)
}

/// Returns the address at which the program goes on after the instruction `word` at `pc`.
fn next<E>(pc: u64, word: u32, x: impl Fn(u32) -> Result<u64, E>) -> Result<u64, E> {
    if word & 3 != 3 {
        return compressed(pc, word, x);
    }
    let [first, second] = [bits(word, 15, 5, 0), bits(word, 20, 5, 0)];
    Ok(match word & 0x7f {
        // JAL
        0x6f => {
            let to = bits(word, 31, 1, 20)
                | bits(word, 12, 8, 12)
                | bits(word, 20, 1, 11)
                | bits(word, 21, 10, 1);
            pc.wrapping_add(offset(to, 20))
        }
        // JALR
        0x67 => x(first)?.wrapping_add(offset(bits(word, 20, 12, 0), 11)) & !1,
        // Branches.
        0x63 => {
            let (a, b) = (x(first)?, x(second)?);
            let is_less = if bits(word, 13, 1, 0) == 0 {
                a.cast_signed() < b.cast_signed()
            } else {
                a < b
            };
            let is_so = if bits(word, 14, 1, 0) == 0 {
                a == b
            } else {
                is_less
            };
            if is_so == (bits(word, 12, 1, 0) == 0) {
                pc.wrapping_add(branch(word))
            } else {
                pc.wrapping_add(4)
            }
        }
        _ => pc.wrapping_add(4),
    })
}

fn compressed<E>(pc: u64, word: u32, x: impl Fn(u32) -> Result<u64, E>) -> Result<u64, E> {
    Ok(match (word & 3, bits(word, 13, 3, 0)) {
        // C.J
        (1, 5) => {
            let to = bits(word, 12, 1, 11)
                | bits(word, 8, 1, 10)
                | bits(word, 9, 2, 8)
                | bits(word, 6, 1, 7)
                | bits(word, 7, 1, 6)
                | bits(word, 2, 1, 5)
                | bits(word, 11, 1, 4)
                | bits(word, 3, 3, 1);
            pc.wrapping_add(offset(to, 11))
        }
        // C.BEQZ, C.BNEZ
        (1, which @ (6 | 7)) if (x(8 + bits(word, 7, 3, 0))? == 0) == (which == 6) => {
            pc.wrapping_add(compressed_branch(word))
        }
        // C.JR, C.JALR
        (2, 4) if bits(word, 2, 5, 0) == 0 && bits(word, 7, 5, 0) != 0 => {
            x(bits(word, 7, 5, 0))? & !1
        }
        _ => pc.wrapping_add(2),
    })
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Each register has 100 times its number; `x5` has -1.
    fn after(word: u32) -> u64 {
        let x = |number: u32| -> Result<u64, ()> {
            Ok(if number == 5 {
                u64::MAX
            } else {
                100 * u64::from(number)
            })
        };
        next(0x1000, word, x).expect("registers are there")
    }

    /// The words are those of LLVM's assembler.
    #[test]
    fn the_next_instruction_is_where_the_program_goes_on() {
        for (what, word, to) in [
            ("addi a0, a0, 1", 0x0015_0513, 0x1004),
            ("jal ra, .+2048", 0x0010_00ef, 0x1800),
            ("jal zero, .-4", 0xffdf_f06f, 0x0ffc),
            ("jalr ra, 16(a0)", 0x0105_00e7, 1016),
            ("jalr zero, -1(a0)", 0xfff5_0067, 998),
            ("beq a0, a0, .+8", 0x00a5_0463, 0x1008),
            ("bne a0, a0, .+8", 0x00a5_1463, 0x1004),
            ("blt t0, a0, .-16", 0xfea2_c8e3, 0x0ff0),
            ("bltu t0, a0, .-16", 0xfea2_e8e3, 0x1004),
            ("bge a0, t0, .+4094", 0x7e55_5fe3, 0x1ffe),
            ("c.addi a0, 1", 0x0505, 0x1002),
            ("c.j .+16", 0xa801, 0x1010),
            ("c.j .-2", 0xbffd, 0x0ffe),
            ("c.beqz s0, .+8", 0xc401, 0x1002),
            ("c.bnez s0, .+8", 0xe401, 0x1008),
            ("c.jr ra", 0x8082, 100),
            ("c.jalr a0", 0x9502, 1000),
            ("c.mv a0, a1", 0x852e, 0x1002),
            ("c.add a0, a1", 0x952e, 0x1002),
        ] {
            assert_eq!(after(word), to, "{what}");
        }
    }

    /// A comparison and exchange, as compilers make it, with the loop behind it.
    #[test]
    fn an_atomic_sequence_is_one_step() {
        const LOOP: [(u64, u32); 5] = [
            (0x1000, 0x1005_a52f), // 1: lr.w a0, (a1)
            (0x1004, 0x00c5_1663), // bne a0, a2, 2f
            (0x1008, 0x18d5_a2af), // sc.w t0, a3, (a1)
            (0x100c, 0xfe02_9ae3), // bnez t0, 1b
            (0x1010, 0x0000_0505), // 2: c.addi a0, 1
        ];
        let step = |pc, words: &[(u64, u32)]| {
            let word = |at| words.iter().find(|(place, _)| *place == at);
            let fetch = |at| Ok::<_, ()>(word(at).map(|(_, word)| *word));
            ends(pc, fetch, |_| Ok(0)).expect("all of it can be read")
        };
        assert_eq!(step(0x1000, &LOOP), [0x1010, 0x100c]);
        // Without its `sc`, an `lr` is stepped as any other instruction.
        assert_eq!(step(0x1000, &LOOP[..2]), [0x1004]);
        assert_eq!(step(0x100c, &LOOP), [0x1010]);
        assert_eq!(step(0x2000, &LOOP), [0_u64; 0]);
    }
}
