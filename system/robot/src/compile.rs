//! Compiles the text files of the hand's configuration, motions and grasps to the files that programs load.

use std::format;
use std::fs;
use std::io;
use std::path::{Path, PathBuf};
use std::string::String;
use std::vec;
use std::vec::Vec;

use condor_hand::config::{ControlProcessor, PROCESSORS, ProcessorKind, TextError};
use condor_hand::grasp::distributed::GraspSettings;
use condor_hand::trajectory::Primitive;
use condor_hand::trajectory::image::encode;
use condor_platform::linux::{WholeFile, read_text};
use thiserror::Error;

use crate::boards::BoardError;
use crate::joints::{JointName, JointNumbers};
use crate::start::IMAGE_BYTES;
use crate::{FINGERS, IMAGE, JOINTS, RobotDescription};

/// Bytes of a sequence that the master has room for.
const BYTES: usize = crate::master::MOTION_BYTES;

/// The greatest length of a name FINGER.JOINT, in bytes: there is room for more behind it in the name of a variable.
const JOINT_NAME_BYTES: usize = 64;

/// The reason why the text of a configuration, a motion or a grasp cannot be compiled.
#[derive(Debug, Error)]
#[non_exhaustive]
pub enum CompileError {
    /// A file or directory cannot be read, made or written.
    #[error("{}: {error}", path.display())]
    Io {
        /// The file or directory.
        path: PathBuf,
        /// The reason.
        error: io::Error,
    },
    /// The text of the configuration, of a motion or of a grasp has a mistake.
    #[error(transparent)]
    Text(#[from] TextError),
    /// A problem without a place, such as a sequence that is too long for the master.
    #[error("{}: {problem}", path.display())]
    Whole {
        /// The file.
        path: PathBuf,
        /// The problem in words.
        problem: String,
    },
}

/// Returns the names of all joints of `hand`, such as `index.proximal`, finger by finger.
#[must_use]
pub fn joint_names(hand: &RobotDescription) -> Vec<String> {
    let joints = 0..JointNumbers::of(hand).count();
    joints
        .map(|number| JointName(hand, number).to_string())
        .collect()
}

/// Reads the text of the robot's configuration in the file `path`, allocates each finger in `served` to the processor
/// of that number, and has `check` check that the boards can serve the robot.
///
/// # Errors
/// Returns [`CompileError::Io`] if the file cannot be read; [`CompileError::Text`] if it has a mistake;
/// [`CompileError::Whole`] if the processors or the boards cannot serve the robot, or if the name of a joint is too
/// long.
pub fn read_robot(
    path: &Path,
    served: &[(u8, &str)],
    check: impl FnOnce(&RobotDescription) -> Result<(), BoardError>,
) -> Result<RobotDescription, CompileError> {
    let text = read_text(path).map_err(io(path))?;
    let mut robot = RobotDescription::from_toml(&text, &path.to_string_lossy())?;
    allocate(&mut robot, served).map_err(whole(path))?;
    check(&robot).map_err(whole(path))?;
    for name in joint_names(&robot) {
        let len = name.len();
        if len > JOINT_NAME_BYTES {
            let problem = format!(
                "the name {name} of a joint, with that of its finger, has {len} bytes; the names of its variables have \
                 room for {JOINT_NAME_BYTES}"
            );
            return Err(whole(path)(problem));
        }
    }
    Ok(robot)
}

/// Allocates fingers to the processors that serve them. A processor that is new to the robot's configuration is like the
/// first one there that serves fingers; one that has lost all of its fingers leaves it.
fn allocate(robot: &mut RobotDescription, served: &[(u8, &str)]) -> Result<(), String> {
    if served.is_empty() {
        return Ok(());
    }
    for (place, (number, name)) in served.iter().enumerate() {
        if let Some((other, _)) = served.iter().take(place).find(|(_, it)| it == name) {
            return Err(format!(
                "processors {other} and {number} serve {name}; name it at one of them"
            ));
        }
        let mut fingers = robot.fingers.iter_mut();
        let Some(finger) = fingers.find(|finger| finger.name == **name) else {
            let known = robot.fingers.iter().map(|finger| finger.name.as_str());
            let known = known.collect::<Vec<_>>().join(", ");
            return Err(format!("the robot has no finger `{name}`; it has {known}"));
        };
        for joint in &mut finger.joints {
            joint.processor = *number;
        }
        if robot.processor(*number).is_none() {
            let mut servos = robot.processors.iter();
            let like = servos.find(|one| one.kind == ProcessorKind::Servo);
            let like = like.ok_or("the robot's configuration has no processor of kind `servo`")?;
            let number = *number;
            let new = ControlProcessor {
                number,
                ..like.clone()
            };
            robot.processors.push(new).map_err(|new| {
                format!(
                    "{} processors are too many: give processor {} no finger",
                    PROCESSORS + 1,
                    new.number
                )
            })?;
        }
    }
    let is_busy = |number| {
        robot
            .fingers
            .iter()
            .any(|finger| finger.processor() == Some(number))
    };
    let idle: Vec<_> = (robot.processors.iter())
        .filter(|one| one.kind == ProcessorKind::Servo && !is_busy(one.number))
        .map(|one| one.number)
        .collect();
    robot.processors.retain(|one| !idle.contains(&one.number));
    robot.check().map_err(|mistake| mistake.to_string())
}

/// Compiles all texts of the hand for its programs, which read them through the file service. `hand` is the file of the
/// configuration; it becomes [`IMAGE`] in the directory `files`. The texts in the directories `motions` and `grasps` of
/// `texts`, if these exist, are compiled to directories of the same names in `files`. Directories are made if they do
/// not exist.
///
/// # Errors
/// Returns the first error; the files before it have been written. It is [`CompileError::Io`] if a file cannot
/// be read or written; [`CompileError::Text`] if a text has a mistake; [`CompileError::Whole`] if a result is
/// too long.
pub fn compile_all(
    robot: &RobotDescription,
    texts: &Path,
    files: &Path,
) -> Result<(), CompileError> {
    fs::create_dir_all(files).map_err(io(files))?;
    let mut image = vec![0; IMAGE_BYTES];
    let path = files.join(IMAGE);
    let len = robot.to_image(&mut image).map_err(whole(&path))?;
    image.truncate(len);
    write(&path, &image)?;
    let motions = texts.join("motions");
    if motions.is_dir() {
        compile_motions(&motions, &files.join("motions"), robot)?;
    }
    let grasps = texts.join("grasps");
    if grasps.is_dir() {
        compile_grasps(&grasps, &files.join("grasps"))?;
    }
    Ok(())
}

fn write(path: &Path, content: &[u8]) -> Result<(), CompileError> {
    WholeFile::write(path, content).map_err(io(path))
}

fn io(path: &Path) -> impl FnOnce(io::Error) -> CompileError + use<> {
    let path = path.to_path_buf();
    |error| CompileError::Io { path, error }
}

fn whole<E: ToString>(path: &Path) -> impl FnOnce(E) -> CompileError + use<E> {
    let path = path.to_path_buf();
    |error| CompileError::Whole {
        path,
        problem: error.to_string(),
    }
}

/// Compiles every motion `NAME.toml` in `directory` to `NAME.motion` in the directory `out`, which is made if it does
/// not exist. They are motions of `hand`. Returns the names of the motions in alphabetical order. Other files in `out` stay as they are.
///
/// # Errors
/// Returns the first error; the files before it have been written. It is [`CompileError::Io`] if a file cannot
/// be read or written; [`CompileError::Text`] if a text has a mistake; [`CompileError::Whole`] if a sequence is
/// too long for the master.
pub fn compile_motions(
    directory: &Path,
    out: &Path,
    hand: &RobotDescription,
) -> Result<Vec<String>, CompileError> {
    compile_texts(directory, out, "motion", |text, path| {
        compile_motion(text, path, hand)
    })
}

/// Compiles every grasp `NAME.toml` in `directory` to `NAME.grasp` in the directory `out`, which is made if it does not
/// exist. Returns the names of the grasps in alphabetical order. Other files in `out` stay as they are.
///
/// # Errors
/// Returns the first error; the files before it have been written. It is [`CompileError::Io`] if a file cannot
/// be read or written; [`CompileError::Text`] if a text has a mistake; [`CompileError::Whole`] if the settings
/// cannot be encoded.
pub fn compile_grasps(directory: &Path, out: &Path) -> Result<Vec<String>, CompileError> {
    compile_texts(directory, out, "grasp", compile_grasp)
}

/// Compiles the texts of a directory to files with this suffix in `out`.
fn compile_texts(
    directory: &Path,
    out: &Path,
    suffix: &str,
    compile: impl Fn(&str, &Path) -> Result<Vec<u8>, CompileError>,
) -> Result<Vec<String>, CompileError> {
    fs::create_dir_all(out).map_err(io(out))?;
    let mut paths = Vec::new();
    for entry in fs::read_dir(directory).map_err(io(directory))? {
        let path = entry.map_err(io(directory))?.path();
        if path
            .extension()
            .is_some_and(|extension| extension == "toml")
        {
            paths.push(path);
        }
    }
    paths.sort();
    let mut compiled = Vec::new();
    for path in paths {
        let text = read_text(&path).map_err(io(&path))?;
        let image = compile(&text, &path)?;
        let name = path.file_stem().unwrap_or_default();
        let name = String::from(name.to_string_lossy());
        write(&out.join(format!("{name}.{suffix}")), &image)?;
        compiled.push(name);
    }
    Ok(compiled)
}

fn compile_grasp(text: &str, path: &Path) -> Result<Vec<u8>, CompileError> {
    let settings = GraspSettings::from_toml(text, &path.to_string_lossy())?;
    let mut bytes = vec![0; GraspSettings::IMAGE_BYTES];
    let len = settings.to_image(&mut bytes).map_err(whole(path))?;
    bytes.truncate(len);
    Ok(bytes)
}

/// Compiles the text of a motion of `hand`, and returns the bytes that the master reads. `path` is the name of the text
/// in errors. Lines and arcs of tips become motions of joints: see
/// [`Hand::motions`](condor_hand::config::Hand::motions).
///
/// # Errors
/// Returns [`CompileError::Text`] if the text has a mistake; [`CompileError::Whole`] if the sequence of motions is too
/// long for the master.
pub fn compile_motion(
    text: &str,
    path: &Path,
    hand: &RobotDescription,
) -> Result<Vec<u8>, CompileError> {
    let motions: Vec<Primitive<{ FINGERS * JOINTS }>> =
        hand.motions(text, &path.to_string_lossy())?;
    let mut bytes = vec![0; BYTES];
    let len = encode(JointNumbers::of(hand).count(), &motions, &mut bytes).map_err(whole(path))?;
    bytes.truncate(len);
    Ok(bytes)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_name_of_a_joint_leaves_room_in_the_names_of_its_variables() {
        let text = include_str!("../../../condor-hand/hands/utah-mit.toml");
        let place = tempfile::tempdir().unwrap();
        let path = place.path().join("robot.toml");
        let read = |finger: usize| {
            let name = format!("name = \"{}\"", "x".repeat(finger));
            fs::write(&path, text.replace("name = \"thumb\"", &name)).unwrap();
            read_robot(&path, &[], |_| Ok(()))
        };
        // Behind it comes `.abduction`.
        assert!(read(54).is_ok());
        let long = read(55).unwrap_err().to_string();
        assert!(
            long.contains("has 65 bytes; the names of its variables have room for 64"),
            "{long}"
        );
    }

    const LINE: &str = r#"
[[motion]]
profile = "minimum-jerk"
duration = 0.5
to = { "index.abduction" = 0.0, "index.proximal" = 0.5, "index.middle" = 0.7, "index.distal" = 0.5 }

[[motion]]
speed = 0.2
line = { finger = "index", by = [0.0, 0.01, 0.015] }
"#;

    fn utah_mit() -> RobotDescription {
        let text = include_str!("../../../condor-hand/hands/utah-mit.toml");
        RobotDescription::from_toml(text, "utah-mit.toml").unwrap()
    }

    #[test]
    fn a_line_that_cannot_be_is_told_with_its_file_and_its_line() {
        let text = LINE.replace("0.015]", "-0.9]");
        let error = compile_motion(&text, Path::new("draw.toml"), &utah_mit()).unwrap_err();
        let error = error.to_string();
        assert!(error.starts_with("draw.toml:9:8: index: at "), "{error}");
    }

    #[cfg(feature = "program")]
    #[test]
    fn a_line_is_the_same_motion_for_the_master_and_in_a_plan() {
        use condor_hand::trajectory::image::MotionSequence;
        use condor_hand::trajectory::{Generator, Observations};
        use condor_host::robot::Simulator as _;
        use condor_scene::HandView;

        const ALL: usize = FINGERS * JOINTS;
        let hand = utah_mit();
        let view = HandView::new(&hand);
        let from = view.moved(&[]).positions;
        let plan = view.plan(&from, LINE, "draw.toml").unwrap();

        let bytes = compile_motion(LINE, Path::new("draw.toml"), &hand).unwrap();
        let motions = MotionSequence::<ALL>::new(from.len(), &bytes).unwrap();
        let mut limits = [hand.trajectory_limits().next().unwrap(); ALL];
        for (place, own) in limits.iter_mut().zip(hand.trajectory_limits()) {
            *place = own;
        }
        let mut start = [0.0; ALL];
        start[..from.len()].copy_from_slice(&from);
        let period_s = 1.0 / f64::from(hand.trajectory_hz);
        let mut generator = Generator::<ALL, 8>::new(limits, start, period_s).unwrap();
        for mut motion in motions.iter() {
            hand.rest_between_stops(&mut motion);
            generator.enqueue(motion).unwrap();
        }
        let mut points = generator.set_points();
        for tick in 0..plan.joints[0].position.len() {
            for (point, joint) in points.iter().zip(&plan.joints) {
                assert_eq!(point.position.to_bits(), joint.position[tick].to_bits());
            }
            points = generator.tick(&Observations::none());
        }
        assert!(generator.is_idle());
    }
}
