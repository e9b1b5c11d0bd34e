//! Each mistake that a person can make in a file, and where it is said to be.
//!
//! A case is a file that ships with one edit: the text of its first occurrence, and what replaces it.
#![cfg(feature = "text")]

use condor_hand::config::Hand;

const UTAH: &str = include_str!("../../hands/utah-mit.toml");
const TRIPOD: &str = include_str!("../hands/tripod.toml");
const DIFFERENTIAL: &str = include_str!("../hands/differential.toml");
const COUPLED: &str = include_str!("../hands/coupled.toml");

fn broken(file: &str, from: &str, to: &str) -> String {
    assert!(file.contains(from), "the file has no `{from}`");
    file.replacen(from, to, 1)
}

fn check(file: &str, from: &str, to: &str, expected: &str) {
    let text = broken(file, from, to);
    let error = Hand::<4, 4, 8>::from_toml(&text, "hand.toml").expect_err(from);
    assert_eq!(error.to_string(), expected);
    let line = text.lines().nth(error.line - 1).unwrap();
    let found: String = line.chars().skip(error.column - 1).collect();
    assert!(
        found.starts_with(&error.text),
        "`{}` is not at the front of `{found}`",
        error.text
    );
}

#[test]
fn a_long_name_leaves_room_for_the_others() {
    let long = "x".repeat(64);
    let text = UTAH.replace("\"index\"", &format!("\"{long}\""));
    let text = broken(&text, "bandwidth_hz = 8.0", "bandwidth_hz = 80.0");
    let error = Hand::<4, 4, 8>::from_toml(&text, "hand.toml").unwrap_err();
    let place = format!(
        "`stop.bandwidth_hz` of joint `abduction` of finger `{}` is 80",
        &long[..40]
    );
    assert!(error.to_string().contains(&place), "{error}");
}

macro_rules! cases {
    ($($name:ident: $file:expr, $from:expr => $to:expr, $expected:expr;)*) => {
        $(#[test]
        fn $name() {
            check($file, $from, $to, $expected);
        })*
    };
}

cases! {
    a_stop_in_which_the_joint_would_swing: UTAH,
        "bandwidth_hz = 8.0" => "bandwidth_hz = 80.0",
        "hand.toml:116:16: `stop.bandwidth_hz` of joint `abduction` of finger `index` is 80; it must be at most 13.5545349121; with its servo and its actuators the joint would swing on a stiffer stop instead of coming to rest\n    80.0";
    no_toml: UTAH,
        "servo_hz = 400 " => "servo_hz = = 400 ",
        "hand.toml:10:12: extra `=`, expected nothing\n    =";
    key_twice: UTAH,
        "trajectory_hz = 50 " => "servo_hz = 50 ",
        "hand.toml:11:1: duplicate key\n    servo_hz";
    unknown_key: UTAH,
        "max_n = 200.0" => "max_m = 200.0",
        "hand.toml:69:1: there is no key `max_m` here; did you mean `max_n`?\n    max_m";
    unknown_key_in_defaults: UTAH,
        "zeta = 1.0" => "zetta = 1.0",
        "hand.toml:111:1: there is no key `zetta` here; did you mean `zeta`?\n    zetta";
    unknown_key_like_no_other: UTAH,
        "safety = 1.2" => "colour = 3",
        "hand.toml:29:1: there is no key `colour` here; it can be `friction`, `safety`\n    colour";
    unknown_word: UTAH,
        "kind = \"table\"" => "kind = \"tabel\"",
        "hand.toml:54:8: `tabel` is none of the choices here; did you mean `table`?\n    \"tabel\"";
    unknown_choice: UTAH,
        "planar = {" => "plenar = {",
        "hand.toml:138:10: `plenar` is none of the choices here; did you mean `planar`?\n    plenar";
    two_choices: UTAH,
        "{ cuboid = [0.0095, 0.018, 0.02] }" => "{ cuboid = [0.0095, 0.018, 0.02], inertia = {} }",
        "hand.toml:156:64: a table stands where a word, or a table with the one key that chooses should be\n    { cuboid = [0.0095, 0.018, 0.02], inertia = {} }";
    no_choice: UTAH,
        "shape = { cuboid = [0.0095, 0.018, 0.02] }" => "shape = 3",
        "hand.toml:156:64: the number 3 stands where a word, or a table with the one key that chooses should be\n    3";
    missing_key: UTAH,
        "trajectory_hz = 50 " => "#",
        "hand.toml:1:1: the key `trajectory_hz` is missing here";
    missing_arms: TRIPOD,
        "arms = { roll = -0.007 }, " => "",
        "hand.toml:56:5: the key `arms` is missing here\n    { name = \"roll-extensor\", limits = { high = 30.0 }, adc = { channel = 2 }, dac = { channel = 1, gain = -25, offset = 1000 } }";
    missing_actuators: DIFFERENTIAL,
        "actuators = [" => "actuator = [",
        "hand.toml:45:1: there is no key `actuator` here; did you mean `actuators`?\n    actuator";
    missing_position: UTAH,
        "adc = { board = 0, channel = 5 }" => "#",
        "hand.toml:197:1: the key `adc.channel` is missing here\n    [[fingers.joints]]";
    missing_effort_sensor: TRIPOD,
        ", adc = { channel = 4 }" => "",
        "hand.toml:57:5: the key `adc.channel` is missing here\n    { name = \"bend-flexor\", arms = { roll = 0.001, bend = 0.006 }, cutoff_hz = 200.0, dac = { channel = 2 } }";
    missing_drive: UTAH,
        ", dac = { board = 1, channel = 22 }" => "",
        "hand.toml:249:5: the key `dac.channel` is missing here\n    { adc = { channel = 30 } }";
    text_for_a_number: UTAH,
        "kp = 1.0" => "kp = \"1.0\"",
        "hand.toml:107:6: the text \"1.0\" stands where a number should be\n    \"1.0\"";
    fraction_for_a_count: UTAH,
        "effort_samples = 20" => "effort_samples = 20.5",
        "hand.toml:17:18: the number 20.5 stands where a whole number from 0 to 65535 should be\n    20.5";
    date: UTAH,
        "safe_s = 0.5" => "safe_s = 1988-01-01",
        "hand.toml:15:10: a time stands where a number should be\n    1988-01-01";
    number_of_more_bits: UTAH,
        "servo_hz = 400 " => "servo_hz = 99999999999999999999 ",
        "hand.toml:10:12: 99999999999999999999 stands where a number of 64 bits should be\n    99999999999999999999";
    channel_beyond_a_byte: UTAH,
        "channel = 15 }\n" => "channel = 300 }\n",
        "hand.toml:263:30: the number 300 stands where a whole number from 0 to 255 should be\n    300";
    vector_too_short: UTAH,
        "gravity = [0.0, 0.0, -9.81]" => "gravity = [0.0, -9.81]",
        "hand.toml:12:11: the list must have 3 entries, not 2\n    [0.0, -9.81]";
    vector_too_long: UTAH,
        "gravity = [0.0, 0.0, -9.81]" => "gravity = [0.0, 0.0, 0.0, -9.81]",
        "hand.toml:12:11: the list must have 3 entries, not 4\n    [0.0, 0.0, 0.0, -9.81]";
    name_too_long: UTAH,
        "name = \"thumb\"" => "name = \"the-thumb-that-opposes-the-three-fingers-of-a-hand-and-has-four-joints\"",
        "hand.toml:237:8: the text has 70 bytes and may have at most 64\n    \"the-thumb-that-opposes-the-three-fingers-of-a-hand-and-has-four-joints\"";
    missing_name: UTAH,
        "name = \"thumb\"" => "#",
        "hand.toml:236:1: the key `name` is missing here\n    [[fingers]]";
    like_nobody: UTAH,
        "name = \"thumb\"\nlike = \"index\"" => "name = \"thumb\"\nlike = \"pinky\"",
        "hand.toml:238:8: no finger `pinky` stands above this one\n    \"pinky\"";
    defaults_no_table: UTAH,
        "joint_defaults = { processor = 2 }" => "joint_defaults = 2",
        "hand.toml:210:18: the number 2 stands where a table of defaults should be\n    2";
    not_finite: UTAH,
        "kv = 0.03" => "kv = nan",
        "hand.toml:108:6: `servo.kv` of joint `abduction` of finger `index` is NaN; it must be finite\n    nan";
    law_without_its_gain: UTAH,
        "bandwidth_hz = 10.0" => "bandwidth_hz = 0.0",
        "hand.toml:110:16: `servo.bandwidth_hz` of joint `abduction` of finger `index` is 0; it must be above 0\n    0.0";
    not_finite_in_a_list: UTAH,
        "center = [0.0216, 0.0, 0.0]" => "center = [0.0216, inf, 0.0]",
        "hand.toml:162:44: `body.center[1]` of joint `proximal` of finger `index` is inf; it must be finite\n    inf";
    not_positive: UTAH,
        "mass_kg = 0.06" => "mass_kg = 0.0",
        "hand.toml:162:20: `body.mass_kg` of joint `proximal` of finger `index` is 0; it must be above 0\n    0.0";
    too_small: UTAH,
        "safety = 1.2" => "safety = 0.9",
        "hand.toml:29:10: `contact.safety` of the hand is 0.9; it must be at least 1\n    0.9";
    budget_above_one: UTAH,
        "loop_us = 4000.0\nbudget = 0.8" => "loop_us = 4000.0\nbudget = 1.8",
        "hand.toml:36:10: `budget` of processor 0 is 1.8; it must be at most 1\n    1.8";
    limits_order: UTAH,
        "low = 0.08726646259971647, high = 1.6580627893946132" => "low = 1.7, high = 1.6580627893946132",
        "hand.toml:167:18: `limits.low` of joint `middle` of finger `index` is 1.7; it must be below `high`, which is 1.65806278939\n    1.7";
    efforts_order: UTAH,
        "low = 4.0, high = 130.0" => "low = 140.0, high = 130.0",
        "hand.toml:125:18: `limits.low` of actuator `abduction-flexor` of finger `index` is 140; it must be below `limits.high`, which is 130\n    140.0";
    low_fault_order: UTAH,
        "below = 1.0" => "below = 4.0",
        "hand.toml:126:20: `faults.below` of actuator `abduction-flexor` of finger `index` is 4; it must be below `limits.low`, which is 4\n    4.0";
    high_fault_order: UTAH,
        "above = 180.0" => "above = 120.0",
        "hand.toml:126:33: `faults.above` of actuator `abduction-flexor` of finger `index` is 120; it must be above 130, its `limits.high`\n    120.0";
    zero_gain: UTAH,
        "gain = 31.5 }   " => "gain = 0.0 }   ",
        "hand.toml:129:27: `dac.gain` of actuator `abduction-flexor` of finger `index` is 0; all counts would mean the same, so give another\n    0.0";
    beyond_adc: UTAH,
        "offset = -1.0471975511965976" => "offset = 0.0",
        "hand.toml:157:7: `adc` of joint `abduction` of finger `index`: a value that it must convert is -0.436332312999; it must be from 0 to 3.1408256632, which its counts can mean; give it another gain or offset\n    { board = 0, channel = 0 }";
    beyond_dac: UTAH,
        "gain = 31.5 }   " => "gain = 32.5 }   ",
        "hand.toml:143:94: `dac` of actuator `abduction-flexor` of finger `index`: a value that it must convert is 130; it must be from 0 to 126, which its counts can mean; give it another gain or offset\n    { board = 0, channel = 0 }";
    no_bits: UTAH,
        "adc = { bits = 12, gain = 7" => "adc = { bits = 0, gain = 7",
        "hand.toml:99:16: `adc.bits` of joint `abduction` of finger `index` is 0; it must be at least 1\n    0";
    too_many_bits: UTAH,
        "adc = { bits = 12, gain = 7" => "adc = { bits = 33, gain = 7",
        "hand.toml:99:16: `adc.bits` of joint `abduction` of finger `index` is 33; it must be at most 32\n    33";
    cutoff: UTAH,
        "zeta = 1.0\nvelocity_cutoff_hz = 100.0" => "zeta = 1.0\nvelocity_cutoff_hz = 200.0",
        "hand.toml:112:22: `servo.velocity_cutoff_hz` of joint `abduction` of finger `index` is 200; it must be below 200\n    200.0";
    effort_cutoff: TRIPOD,
        "cutoff_hz = 200.0" => "cutoff_hz = 1000.0",
        "hand.toml:55:66: `cutoff_hz` of actuator `roll-flexor` of finger `a` is 1000; it must be below 1000\n    1000.0";
    not_rotation: UTAH,
        "[0.0, -1.0, 0.0], [0.0, 0.0, -1.0]" => "[0.0, -1.0, 0.1], [0.0, 0.0, -1.0]",
        "hand.toml:239:57: `base.rotation` of finger `thumb`: the greatest difference of its axes from orthogonal unit vectors is 0.1; it must be at most 0.000000001\n    { rows = [[1.0, 0.0, 0.0], [0.0, -1.0, 0.1], [0.0, 0.0, -1.0]] }";
    reflection: UTAH,
        "[0.0, -1.0, 0.0], [0.0, 0.0, -1.0]" => "[0.0, 1.0, 0.0], [0.0, 0.0, -1.0]",
        "hand.toml:239:57: `base.rotation` of finger `thumb`: its determinant is -1; it must be 1; a left-handed frame has -1\n    { rows = [[1.0, 0.0, 0.0], [0.0, 1.0, 0.0], [0.0, 0.0, -1.0]] }";
    not_unit: TRIPOD,
        "motion = { revolute = [0.0, 1.0, 0.0] }" => "motion = { revolute = [0.0, 2.0, 0.0] }",
        "hand.toml:74:100: `mount.motion.revolute` of joint `bend` of finger `a`: its length is 2; it must be 1\n    [0.0, 2.0, 0.0]";
    direction: UTAH,
        "direction = [0.0, 1.0, 0.0]" => "direction = [0.0, 1.0, 1.0]",
        "hand.toml:74:13: `direction` of axis `y`: its length is 1.41421356237; it must be 1\n    [0.0, 1.0, 1.0]";
    rotation_axis: TRIPOD,
        "axis = { axis = [0.0, 0.0, 1.0], angle = 2" => "axis = { axis = [0.0, 0.0, 0.0], angle = 2",
        "hand.toml:88:85: `base.rotation.axis.axis` of finger `b`: its length is 0; it must be 1\n    [0.0, 0.0, 0.0]";
    not_inertia: TRIPOD,
        "moments = [2e-6, 3e-6, 4e-6]" => "moments = [1e-6, 1e-6, 4e-6]",
        "hand.toml:68:87: `body.shape.inertia.moments` of joint `roll` of finger `a` is no inertia of a body; in any axes each moment must be above 0 and at most the sum of the two others\n    [1e-6, 1e-6, 4e-6]";
    products_too_large: TRIPOD,
        "products = [1e-7, 0.0, -1e-7]" => "products = [1e-5, 0.0, -1e-7]",
        "hand.toml:68:87: `body.shape.inertia.moments` of joint `roll` of finger `a` is no inertia of a body; in any axes each moment must be above 0 and at most the sum of the two others\n    [2e-6, 3e-6, 4e-6]";
    flat_cuboid: UTAH,
        "cuboid = [0.033, 0.018, 0.02]" => "cuboid = [0.033, 0.018, 0.0]",
        "hand.toml:168:89: `body.shape.cuboid[2]` of joint `middle` of finger `index` is 0; it must be above 0\n    0.0";
    no_name: UTAH,
        "name = \"thumb\"" => "name = \" \"",
        "hand.toml:237:8: `name` of finger ` ` is empty; it must have letters\n    \" \"";
    finger_twice: UTAH,
        "name = \"thumb\"" => "name = \"ring\"",
        "hand.toml:237:8: `name` of finger `ring` is taken already; give each its own\n    \"ring\"";
    joint_twice: TRIPOD,
        "name = \"bend\"" => "name = \"roll\"",
        "hand.toml:72:8: `name` of joint `roll` of finger `a` is taken already; give each its own\n    \"roll\"";
    axis_twice: UTAH,
        "name = \"z\"" => "name = \"y\"",
        "hand.toml:85:8: `name` of axis `y` is taken already; give each its own\n    \"y\"";
    no_joints: TRIPOD,
        "[[fingers]]\nname = \"b\"" => "[[fingers]]\nname = \"d\"\nbase = {}\nform = { chain = { tip = [0, 0, 0] } }\njoints = []\nactuators = []\n\n[[fingers]]\nname = \"b\"",
        "hand.toml:89:10: `joints` of finger `d` is empty; it must have one entry or more\n    []";
    processor_twice: UTAH,
        "number = 5" => "number = 2",
        "hand.toml:53:10: `number` of processor 2 is taken already; give each its own\n    2";
    no_processor: UTAH,
        "joint_defaults = { processor = 2 }" => "joint_defaults = { processor = 9 }",
        "hand.toml:210:32: `processor` of joint `abduction` of finger `ring` is 9; it must be the number of a servo processor of the hand\n    9";
    wrong_kind: UTAH,
        "joint_defaults = { processor = 2 }" => "joint_defaults = { processor = 5 }",
        "hand.toml:210:32: `processor` of joint `abduction` of finger `ring` is 5; it must be the number of a servo processor of the hand\n    5";
    axis_on_a_servo: UTAH,
        "direction = [0.0, 1.0, 0.0]\nprocessor = 5" => "direction = [0.0, 1.0, 0.0]\nprocessor = 1",
        "hand.toml:75:13: `processor` of axis `y` is 1; it must be the number of a table processor of the hand\n    1";
    split_finger: UTAH,
        "adc = { board = 0, channel = 6 }" => "processor = 2\nadc = { board = 0, channel = 6 }",
        "hand.toml:201:13: `processor` of joint `middle` of finger `middle` is 2; it must be 1 like that of the finger's first joint; actuators couple the joints of a finger, so give them all one processor\n    2";
    rate: UTAH,
        "trajectory_hz = 50 " => "trajectory_hz = 60 ",
        "hand.toml:10:12: `servo_hz` of the hand is 400; it must be a multiple of 60, the trajectories' rate\n    400";
    rate_of_a_processor: TRIPOD,
        "rate_hz = 2000" => "rate_hz = 1950",
        "hand.toml:24:11: `rate_hz` of processor 7 is 1950; it must be a multiple of 100, the trajectories' rate\n    1950";
    rate_zero: UTAH,
        "trajectory_hz = 50 " => "trajectory_hz = 0 ",
        "hand.toml:11:17: `trajectory_hz` of the hand is 0; it must be above 0\n    0";
    load: UTAH,
        "joint_us = 100.0" => "joint_us = 240.0",
        "hand.toml:43:10: `budget` of processor 1 is 0.8; it must be at least 0.828, which its loop takes of its time; give it fewer joints or axes, or a lower rate\n    0.8";
    same_adc_channel: UTAH,
        "adc = { board = 0, channel = 13 }" => "adc = { board = 0, channel = 2 }",
        "hand.toml:257:30: `adc.channel` of joint `proximal` of finger `thumb` is A/D channel 2 of board 0; `fingers[0].joints[2].adc.channel` is the same, and a channel has one wire\n    2";
    same_dac_channel: UTAH,
        "dac = { board = 1, channel = 23 }" => "dac = { board = 2, channel = 2 }",
        "hand.toml:89:30: `dac.channel` of axis `z` is D/A channel 2 of board 2; `fingers[3].actuators[7].dac.channel` is the same, and a channel has one wire\n    2";
    arm_at_no_joint: UTAH,
        "{ proximal = 0.0095, middle = 0.0095 }" => "{ proximal = 0.0095, midle = 0.0095 }",
        "hand.toml:147:67: `arms.midle` of actuator `middle-flexor` of finger `index` is at no joint of the finger; name one of its joints\n    0.0095";
    arm_of_zero: UTAH,
        "{ proximal = 0.0095, middle = 0.0095 }" => "{ proximal = 0.0, middle = 0.0095 }",
        "hand.toml:147:51: `arms.proximal` of actuator `middle-flexor` of finger `index` is 0; leave out a joint that it does not move\n    0.0";
    no_arms: TRIPOD,
        "arms = { roll = 0.001, bend = 0.006 }" => "arms = {}",
        "hand.toml:57:36: `arms` of actuator `bend-flexor` of finger `a` is empty; it must have one entry or more\n    {}";
    arm_twice: UTAH,
        "{ proximal = 0.0095, middle = 0.0095 }" => "{ proximal = 0.0095, proximal = 0.0095 }",
        "hand.toml:147:59: duplicate key\n    proximal";
    arm_not_finite: TRIPOD,
        "bend = 0.006" => "bend = inf",
        "hand.toml:57:59: `arms.bend` of actuator `bend-flexor` of finger `a` is inf; it must be finite\n    inf";
    actuator_twice: TRIPOD,
        "name = \"nail-in\"" => "name = \"nail-out\"",
        "hand.toml:61:14: `name` of actuator `nail-out` of finger `a` is taken already; give each its own\n    \"nail-out\"";
    actuator_without_a_name: TRIPOD,
        "name = \"nail-in\", " => "",
        "hand.toml:61:5: the key `name` is missing here\n    { arms = { nail = -1.0 }, limits = { high = 30.0, bias = 5.0 }, adc = { channel = 8 }, dac = { channel = 5, gain = -25, offset = 1000 } }";
    actuator_without_a_pole: UTAH,
        "pole_hz = 20.0" => "pole_hz = 0.0",
        "hand.toml:127:11: `pole_hz` of actuator `abduction-flexor` of finger `index` is 0; it must be above 0\n    0.0";
    negative_gain_of_an_actuator: UTAH,
        "gains = { kp = 1.0 }" => "gains = { kp = 1.0, kv = -1.0 }",
        "hand.toml:130:26: `gains.kv` of actuator `abduction-flexor` of finger `index` is -1; it must be at least 0\n    -1.0";
    unknown_key_of_an_actuator: UTAH,
        "bias = 7.0" => "bais = 7.0",
        "hand.toml:125:37: there is no key `bais` here; did you mean `bias`?\n    bais";
    old_key_of_a_joint: TRIPOD,
        "adc = { board = 0, channel = 0 }" => "flexor = { arm_m = 0.006 }\nadc = { board = 0, channel = 0 }",
        "hand.toml:69:1: there is no key `flexor` here; it can be `name`, `processor`, `mount`, `body`, `limits`, `servo`, `stop`, `friction`, `adc`\n    flexor";
    joint_that_nothing_moves: TRIPOD,
        "nail = 1.0 }, limits = { bias = 5.0 }, cutoff_hz = 200.0, adc = { channel = 7 }, dac = { channel = 4 } },\n    { name = \"nail-in\", arms = { nail = -1.0 }" => "bend = 1.0 }, limits = { bias = 5.0 }, cutoff_hz = 200.0, adc = { channel = 7 }, dac = { channel = 4 } },\n    { name = \"nail-in\", arms = { bend = -1.0 }",
        "hand.toml:79:1: joint `nail` of finger `a` is moved by no actuator; give an actuator an arm at the joint, in its `arms`\n    [[fingers.joints]]";
    joint_that_always_has_a_torque: TRIPOD,
        "{ name = \"nail-out\", arms = { nail = 1.0 }" => "{ name = \"nail-out\", arms = { nail = -1.0 }",
        "hand.toml:79:1: joint `nail` of finger `a` is never without a torque; no efforts within the `limits` of its actuators cancel there; change their limits or their arms\n    [[fingers.joints]]";
    parallel_actuators: DIFFERENTIAL,
        "arms = { pitch = 1.0, roll = -1.0 }" => "arms = { pitch = 2.0, roll = 2.0 }",
        "hand.toml:50:1: joint `pitch` of finger `wrist` is without a torque of its own; its actuators move it only together with joints after it; add an actuator or change an arm\n    [[fingers.joints]]";
    fault_without_a_sensor: DIFFERENTIAL,
        "pole_hz = 100.0" => "pole_hz = 100.0\nfaults = { below = -2.5 }",
        "hand.toml:47:5: `faults` of actuator `left` of finger `wrist` is needless; the actuator has no sensor of its effort (`adc`), so leave them out\n    { name = \"left\", arms = { pitch = 1.0, roll = 1.0 }, dac = { channel = 0 } }";
    filter_without_a_sensor: DIFFERENTIAL,
        "pole_hz = 100.0" => "pole_hz = 100.0\ncutoff_hz = 50.0",
        "hand.toml:39:13: `cutoff_hz` of actuator `left` of finger `wrist` is needless; the actuator has no sensor of its effort (`adc`), so leave it out\n    50.0";
    feedback_without_a_sensor: DIFFERENTIAL,
        "pole_hz = 100.0" => "pole_hz = 100.0\ngains = { kp = 1.0 }",
        "hand.toml:39:16: `gains.kp` of actuator `left` of finger `wrist` is 1; it must be 0, since the actuator has no sensor of its effort (`adc`)\n    1.0";
    torque_gain_without_sensors: DIFFERENTIAL,
        "bandwidth_hz = 8.0," => "bandwidth_hz = 8.0, k_tau = 0.5,",
        "hand.toml:31:58: `servo.k_tau` of joint `pitch` of finger `wrist` is 0.5; it must be 0, since an actuator of the joint has no sensor of its effort (`adc`)\n    0.5";
    dac_of_one_sign: DIFFERENTIAL,
        "offset = 2048.0" => "offset = 0.0",
        "hand.toml:46:64: `dac` of actuator `left` of finger `wrist`: a value that it must convert is -2; it must be from 0 to 4.095, which its counts can mean; give it another gain or offset\n    { channel = 0 }";
    finger_of_no_motors: DIFFERENTIAL,
        "    { name = \"left\", arms = { pitch = 1.0, roll = 1.0 }, dac = { channel = 0 } },\n    { name = \"right\", arms = { pitch = 1.0, roll = -1.0 }, dac = { channel = 1 } },\n" => "",
        "hand.toml:48:1: joint `pitch` of finger `wrist` is moved by no actuator; give an actuator an arm at the joint, in its `arms`\n    [[fingers.joints]]";
    too_few_motors: DIFFERENTIAL,
        "    { name = \"right\", arms = { pitch = 1.0, roll = -1.0 }, dac = { channel = 1 } },\n" => "",
        "hand.toml:49:1: joint `pitch` of finger `wrist` is without a torque of its own; its actuators move it only together with joints after it; add an actuator or change an arm\n    [[fingers.joints]]";
    efforts_that_are_equal: DIFFERENTIAL,
        "limits = { low = -2.0, high = 2.0 }" => "limits = { low = 2.0, high = 2.0 }",
        "hand.toml:37:18: `limits.low` of actuator `left` of finger `wrist` is 2; it must be below `limits.high`, which is 2\n    2.0";
    low_not_finite: DIFFERENTIAL,
        "limits = { low = -2.0, high = 2.0 }" => "limits = { low = -inf, high = 2.0 }",
        "hand.toml:37:18: `limits.low` of actuator `left` of finger `wrist` is -inf; it must be finite\n    -inf";
    planar_joints: TRIPOD,
        "form = { chain = { tip = [0.02, 0.0, 0.0] } }" => "form = { planar = { lengths = [0.0, 0.03, 0.03, 0.02] } }",
        "hand.toml:50:1: finger `a`: the number of its joints is 3; it must be 4 in a planar finger; for another number write `form = { chain = … }`\n    [[fingers]]";
    off_axis: UTAH,
        "center = [0.0216, 0.0, 0.0]" => "center = [0.0216, 0.001, 0.0]",
        "hand.toml:162:35: `body.center` of joint `proximal` of finger `index` is not on the x axis; the links of a planar finger are; write `form = { chain = … }` for others\n    [0.0216, 0.001, 0.0]";
    off_axis_inertia: UTAH,
        "shape = { cuboid = [0.0432, 0.018, 0.02] }" => "shape = { inertia = { moments = [4e-6, 1e-5, 1e-5], products = [1e-7, 0.0, 0.0] } }",
        "hand.toml:162:118: `body.shape.inertia.products` of joint `proximal` of finger `index` is not on the x axis; the links of a planar finger are; write `form = { chain = … }` for others\n    [1e-7, 0.0, 0.0]";
    no_mount: TRIPOD,
        "mount = { motion = { revolute = [1.0, 0.0, 0.0] } }" => "#",
        "hand.toml:64:1: `mount` of joint `roll` of finger `a` is missing; a joint of a chain needs one\n    [[fingers.joints]]";
    follower_of_nobody: COUPLED,
        "follows = { joint = \"middle\"" => "follows = { joint = \"thumb\"",
        "hand.toml:78:21: `follows.joint` of follower `distal` of finger `finger` is no joint of the finger; name one of its joints\n    \"thumb\"";
    follower_of_a_follower: COUPLED,
        "follows = { joint = \"middle\"" => "follows = { joint = \"distal\"",
        "hand.toml:78:21: `follows.joint` of follower `distal` of finger `finger` is a follower itself; follow the joint that moves by itself\n    \"distal\"";
    follower_that_stands: COUPLED,
        "ratio = 0.9" => "ratio = 0.0",
        "hand.toml:78:39: `follows.ratio` of follower `distal` of finger `finger` is 0; a joint that does not move belongs to the link that carries it\n    0.0";
    follower_without_a_ratio: COUPLED,
        "ratio = 0.9, " => "",
        "hand.toml:78:11: the key `ratio` is missing here\n    { joint = \"middle\", offset = 0.1 }";
    follower_far_off: COUPLED,
        "offset = 0.1" => "offset = nan",
        "hand.toml:78:53: `follows.offset` of follower `distal` of finger `finger` is NaN; it must be finite\n    nan";
    follower_with_the_name_of_a_joint: COUPLED,
        "name = \"distal\"" => "name = \"middle\"",
        "hand.toml:77:8: `name` of follower `middle` of finger `finger` is taken already; give each its own\n    \"middle\"";
    follower_of_a_planar_finger: COUPLED,
        "form = { chain = { tip = [0.0241, 0.0, 0.0], on = \"distal\" } }" => "form = { planar = { lengths = [0.0, 0.03, 0.03, 0.02] } }",
        "hand.toml:76:1: follower `distal` of finger `finger` is needless; in a planar finger all joints move by themselves; write `form = { chain = … }`\n    [[fingers.followers]]";
    follower_on_nothing: COUPLED,
        "mount = { position = [0.033, 0.0, 0.0]" => "mount = { on = \"palm\", position = [0.033, 0.0, 0.0]",
        "hand.toml:79:16: `mount.on` of follower `distal` of finger `finger` is no joint of the finger; name a joint or a follower, or `base`\n    \"palm\"";
    follower_on_itself: COUPLED,
        "mount = { position = [0.033, 0.0, 0.0]" => "mount = { on = \"distal\", position = [0.033, 0.0, 0.0]",
        "hand.toml:79:16: `mount.on` of follower `distal` of finger `finger` is the joint itself, or one that it carries; name one between the base and this joint\n    \"distal\"";
    joint_on_a_later_one: COUPLED,
        "mount = { position = [0.0095, 0.0, 0.0]" => "mount = { on = \"middle\", position = [0.0095, 0.0, 0.0]",
        "hand.toml:66:16: `mount.on` of joint `proximal` of finger `finger` is the joint itself, or one that it carries; name one between the base and this joint\n    \"middle\"";
    tip_of_no_joint: COUPLED,
        "on = \"distal\"" => "on = \"nail\"",
        "hand.toml:47:51: `form.chain.on` of finger `finger` is no joint of the finger; name one of its joints or followers\n    \"nail\"";
    tip_of_a_finger_with_followers: COUPLED,
        ", on = \"distal\"" => "",
        "hand.toml:47:18: `form.chain.on` of finger `finger` is missing; the finger has followers, so name the joint that moves the tip\n    { tip = [0.0241, 0.0, 0.0] }";
    arm_at_nothing: COUPLED,
        "distal = 0.008" => "nail = 0.008",
        "hand.toml:53:83: `arms.nail` of actuator `middle-flexor` of finger `finger` is at no joint of the finger; name one of its joints\n    0.008";
    needless_mount: UTAH,
        "adc = { board = 0, channel = 1 }" => "mount = { motion = { revolute = [0.0, 1.0, 0.0] } }\nadc = { board = 0, channel = 1 }",
        "hand.toml:163:9: `mount` of joint `proximal` of finger `index` is needless; in a planar finger the lengths say where joints are, so leave it out\n    { motion = { revolute = [0.0, 1.0, 0.0] } }";
    stop_zone: UTAH,
        "zone = 0.05235987755982988" => "zone = 0.5",
        "hand.toml:115:8: `stop.zone` of joint `abduction` of finger `index` is 0.5; it must be at most 0.436332312999\n    0.5";
    bias_below_least: TRIPOD,
        "limits = { bias = 5.0 }" => "limits = { bias = 0.5 }",
        "hand.toml:60:67: `limits.bias` of actuator `nail-out` of finger `a` is 0.5; it must be from 1 to 40, its `low` and its `high`\n    0.5";
    antagonists_apart: TRIPOD,
        "{ name = \"roll-flexor\", arms" => "{ name = \"roll-flexor\", limits = { low = 39.0 }, arms",
        "hand.toml:64:1: joint `roll` of finger `a` is never without a torque; no efforts within the `limits` of its actuators cancel there; change their limits or their arms\n    [[fingers.joints]]";
    no_torque_of_its_own: UTAH,
        "proximal = 0.0127 }, adc = { channel = 2 }, dac = { board = 0, channel = 2 } },\n    { name = \"proximal-extensor\", arms = { proximal = -0.0127 }" => "proximal = 1e-7 }, adc = { channel = 2 }, dac = { board = 0, channel = 2 } },\n    { name = \"proximal-extensor\", arms = { proximal = -1e-7 }",
        "hand.toml:159:1: joint `proximal` of finger `index` is without a torque of its own; its actuators move it only together with joints after it; add an actuator or change an arm\n    [[fingers.joints]]";
    coulomb_without_rate: TRIPOD,
        "coulomb_rate = 0.1" => "coulomb_rate = 0.0",
        "hand.toml:40:46: `friction.coulomb_rate` of joint `roll` of finger `a` is 0; it must be above 0\n    0.0";
    rest_too_soon: UTAH,
        "safe_s = 0.5" => "safe_s = 0.004",
        "hand.toml:15:10: `faults.safe_s` of the hand is 0.004; it must be at least 0.005\n    0.004";
    rest_too_late: UTAH,
        "safe_s = 0.5" => "safe_s = 1e8",
        "hand.toml:15:10: `faults.safe_s` of the hand is 100000000; it must be at most 10737418.2375\n    1e8";
    too_large_to_compute_with: UTAH,
        "stale_s = 0.06" => "stale_s = 1e16",
        "hand.toml:16:11: `faults.stale_s` of the hand is 10000000000000000; it must be at most 1000000000000000\n    1e16";
    home: UTAH,
        "direction = [0.0, 1.0, 0.0]" => "home = 0.3\ndirection = [0.0, 1.0, 0.0]",
        "hand.toml:74:8: `home` of axis `y` is 0.3; it must be at most 0.2\n    0.3";
}

/// Whatever number with a point is no number, the file is refused.
#[test]
fn every_number_must_be_finite() {
    let is_of_number = |letter: char| letter.is_ascii_digit() || ".-+e".contains(letter);
    for (file, least) in [(UTAH, 150), (TRIPOD, 100), (DIFFERENTIAL, 40)] {
        let mut checked = 0;
        let mut at = 0;
        while let Some(point) = file[at..].find('.') {
            let point = at + point;
            at = point + 1;
            let begin = file[..point].rfind(|letter| !is_of_number(letter)).unwrap() + 1;
            let end = point + file[point..].find(|letter| !is_of_number(letter)).unwrap();
            let line = &file[file[..point].rfind('\n').map_or(0, |line| line + 1)..point];
            if line.contains('#') || file[begin..end].parse::<f64>().is_err() {
                continue;
            }
            for no_number in ["nan", "-inf", "1e16"] {
                let text = [&file[..begin], no_number, &file[end..]].concat();
                let error = Hand::<4, 4, 8>::from_toml(&text, "hand.toml").expect_err(line);
                let told = error.to_string();
                assert!(
                    told.contains("finite") || told.contains("at most 1000000000000000"),
                    "{told}"
                );
            }
            checked += 1;
        }
        assert!(checked > least, "{checked}");
    }
}

#[test]
fn a_list_that_the_program_has_no_room_for() {
    let error = Hand::<3, 4, 8>::from_toml(UTAH, "hand.toml").unwrap_err();
    let fingers =
        "hand.toml:236:1: this entry is one too many; the program has room for 3\n    [[fingers]]";
    assert_eq!(error.to_string(), fingers);
    let error = Hand::<3, 2, 6>::from_toml(TRIPOD, "hand.toml").unwrap_err();
    let joints = "hand.toml:79:1: this entry is one too many; the program has room for 2\n    [[fingers.joints]]";
    assert_eq!(error.to_string(), joints);
    let error = Hand::<3, 3, 5>::from_toml(TRIPOD, "hand.toml").unwrap_err();
    let actuators = "hand.toml:61:5: this entry is one too many; the program has room for 5\n    { name = \"nail-in\"";
    assert!(error.to_string().starts_with(actuators), "{error}");
}
