//! Every interleaving, as far as each model says, of those who pass the turn.
//!
//! The shipped page and its rules, with a futex that remembers no wake. Loom finds two who have the turn,
//! by a cell that each writes, and turns that get lost, by a deadlock: no sleep ends by itself, but for
//! one of each survivor after a death. That no time passes what is due is asserted: every wait says at
//! which instant it is to end. `kills` kills before every access, by the hook in `condor_clock::sync`.
//!
//! The bound of preemptions stands at each model. Measured, release build, two busy cores: 700 000
//! executions, two minutes in all; the longest is `a_processor_is_killed_and_restarted`, 119 000, 38 s.
//!
//! Wrong variants of the rules, and a model that finds each:
//!
//! | variant | found by |
//! |---|---|
//! | no second look after the turn is free | `a_kick_is_not_lost` |
//! | no fence in `kick`, or before the second look | `a_kick_is_not_lost` |
//! | `grants` is read after the holder, is not counted, or nobody is woken | `a_kick_is_not_lost` |
//! | a ring makes nobody due | `a_kick_is_not_lost` |
//! | time is moved after the turn is passed; the greater number first | `two_enter_and_take_turns` |
//! | holds do not count; a hold ends before the role is there | `two_enter_and_take_turns` |
//! | the turn is passed without Release | `two_enter_and_take_turns` |
//! | one that leaves rings nobody, or holds the turn by its own number meanwhile | `rings_end_waits_at_their_instants` |
//! | `kick` takes the turn by the caller's own number | `another_thread_of_a_program_rings` |
//! | rings are counted without Release | `an_answer_is_seen_with_its_ring` |
//! | services are not asked, or after the processors | `time_waits_for_a_service` |
//! | services are asked in one walk; `consumed` is stored without Release | `time_waits_for_a_chain_of_services` |
//! | parts of the host in the order of numbers; a free turn before the instant of the request | `a_guest_has_its_turn_at_its_instant` |
//! | no look whether the receiver has gone; no fence before it, or in `take_from` | `a_guest_comes_and_goes` |
//! | a guest gives up and keeps the turn | `a_guest_comes_and_goes` |
//! | the giver takes back any turn of the receiver | `a_giver_sees_two_incarnations` |
//! | nobody is buried | `a_giver_sees_two_incarnations` |
//! | a first turn is not given on that was meant for a former incarnation | `a_processor_is_killed_and_restarted` |
//! | `free` forgets those that had the turn in vain | `the_giver_of_a_dead_one_is_killed` |
//! | `free` forgets those that died while they gave the turn on | `a_guest_is_killed` |
//! | a service does not kick when it is done, or keeps its request when it finishes | `a_service_is_killed_and_restarted` |
//! | a service does not finish what its former incarnation was to give on | `a_service_is_killed_and_restarted` |
//!
//! Three are found by the unit tests alone: a burial that rings last, a number that is not cleared for its
//! next incarnation, and `free` that leaves the request. No test finds these, which other rules cover: a turn that
//! is passed without Acquire and a role that is stored without Release (the fences of `kick` and `give` order
//! what they do), and no kick after a sleep that took too long (the supervisor's burial kicks, too).
#![cfg(condor_loom)]

mod hosts;
mod kills;
mod processors;
mod world;
