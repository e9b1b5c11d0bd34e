//! [`Commands`]: what is typed.

use core::fmt::{Arguments, Write as _};

use condor_hand::grasp::distributed::{GraspOrder, GraspSettings};
use condor_hand::message::motions::{BODY_BYTES, MotionsEvent};
use condor_hand::queue::{RefusalReason, RequestIdentity, RequestState};
use condor_hand::servo::ServoMode;
use condor_hand::trajectory::image::encode_for;
use condor_hand::trajectory::{Begin, Pace, Profile, Target};
use condor_mbox::{Allocator, Instant};
use condor_rt::{Background, Machine, ProgramError};

use super::drive::{Motion, SharedDrive, with};
use super::follow::Follow;
use super::others::{Ball, Others};
use super::play::{Player, Title};
use super::queue::{Requests, Work};
use super::sequence::Store;
use super::servos::Servos;
use super::servos::are_all;
use super::words::{Problem, Words};
use crate::grasp;
use crate::joints::JointNumbers;
use crate::plant::{self, NumberRange, PlantTarget};
use crate::table::{self, TableStatus};
use crate::{FINGERS, JOINTS, RobotDescription};

mod complete;
mod gains;
mod hold;
mod list;
mod modes;
mod processors;
mod shown;
mod watch;

use list::{Command, Line, commands, find, nearest};
pub(super) use processors::Processors;
use shown::{Boards, MeasuredObject, MixedModes, Row, Titles};
pub(super) use watch::Watching;

commands! {
    "help" "[COMMAND]" "lists the commands, or explains one" "help to" help;
    "status" "" "shows fingers, motion, object and table" "status" status;
    "watch" "[FINGER|FINGER.JOINT]..." "shows joints live, until a key is typed"
        "watch index thumb.distal" watch_joints;
    "enable" "[FINGER]" "restarts if failed; holds the position" "enable index" enable;
    "disable" "[FINGER]" "lets go: least tension on both tendons" "disable index" disable;
    "run" "[MOTION]" "runs a motion, or the one in memory" "run wave" run;
    "control" "" "takes control from another program" "control" control;
    "motions" "" "lists the names of all motions" "motions" motions;
    "pause" "" "pauses the motion" "pause" pause;
    "resume" "" "continues the paused motion" "resume" resume;
    "abort" "" "ends the motion; so does Ctrl-C" "abort" abort;
    "to" "FINGER.JOINT RAD [SECONDS]" "moves one joint" "to index.middle 0.9 0.5" to;
    "torque" "FINGER.JOINT NM" "sets the torque of the joint's tendons" "torque index.middle 0.05" torque;
    "tension" "FINGER.JOINT N N" "sets tensions of flexor and extensor" "tension index.middle 8 8" tension;
    "impedance" "FINGER[.JOINT] NM_PER_RAD [NM_S_PER_RAD [RAD]]" "acts as a spring" "impedance index 0.5" impedance;
    "mode" "FINGER[.JOINT] MODE" "sets the way to control joints" "mode index impedance" mode;
    "gains" "FINGER.JOINT [GAIN VALUE]..." "shows or sets gains of the controller"
        "gains index.middle damping_ratio 1" gains;
    "record" "MOTION" "records motions until `save`" "record mine" record;
    "save" "[MOTION]" "saves the recorded motions in a file" "save mine" save;
    "load" "MOTION|PROCESSOR [PROGRAM [WORD]...]" "loads a motion, or starts a program" "load wave" load;
    "restart" "PROCESSOR" "restarts the program of a processor" "restart 1" restart;
    "table" "[home|stop|off|clear|X Y Z [SPEED]]" "moves the palm to X Y Z, m" "table 0.05 0 -0.02 0.5" table;
    "grasp" "[N/M|STIFFNESS]" "grasps the ball where the camera sees it" "grasp 150" grasp;
    "release" "" "lets go of the ball" "release" release;
    "ball" "[none|RADIUS [MASS [X Y Z]]]" "adds a simulated ball, held until `letgo`" "ball 0.02 0.05" ball;
    "letgo" "[SECONDS]" "leaves the ball to the fingers alone" "letgo 1" letgo;
    "push" "X Y Z [X Y Z]" "pushes the ball: force, N; moment, N m" "push 0.2 0 0" push;
    "weight" "FINGER KG" "hangs a simulated weight on a fingertip" "weight index 0.1" weight;
    "fault" "FINGER.JOINT position|flexor|extensor" "simulates a broken part" "fault thumb.distal position" fault;
    "clear" "" "mends faults; restarts a failed robot" "clear" clear;
}

const SECONDS: &str = "a time above 0, s";

/// The state that commands share.
pub(super) struct Commands<'r, 'p, M: Machine> {
    pub(super) hand: &'r RobotDescription,
    pub(super) numbers: JointNumbers,
    pub(super) background: &'r Background<'r, M>,
    pub(super) shared: &'r SharedDrive<'p, M::Window>,
    pub(super) servos: Servos<'r, 'p, M>,
    pub(super) player: Player,
    pub(super) follow: Follow<M>,
    pub(super) closing: Option<Closing>,
    pub(super) store: Store<'r, M>,
    pub(super) requests: Requests<'r, M>,
    pub(super) others: Others<'r, M>,
    pub(super) processors: Processors<'r, M>,
    pub(super) watching: Watching<M::Window>,
    /// The room for clients of parameters.
    pub(super) tuning: Allocator,
}

/// A grasp whose fingers close: it is ordered again when they have closed, about where the ball is then.
pub(super) struct Closing {
    settings: GraspSettings,
    until: Instant,
}

/// Says lines on the terminal.
pub(super) fn said<'r, M: Machine>(
    background: &'r Background<'r, M>,
) -> impl Fn(Arguments<'_>) + 'r {
    |line| background.print(format_args!("{line}\n"))
}

impl<'r, 'p, M: Machine> Commands<'r, 'p, M> {
    /// Obeys a line, or says why not.
    pub(super) fn obey(&mut self, line: &str) {
        let mut words = Words::of(line);
        let Some(word) = words.next() else {
            return;
        };
        if let Err(problem) = self.execute(word, &mut words) {
            self.explain(line, word, &problem);
        }
        self.stop_if_lost();
    }

    /// Says why a line is not done: in which word the mistake is, and what was expected.
    fn explain(&self, line: &str, word: &str, problem: &Problem<'_>) {
        let Some(number) = problem.place(line) else {
            return self.say(format_args!("{problem}"));
        };
        self.say(format_args!("word {number}: {problem}"));
        if let Some(command) = find(COMMANDS, word) {
            let example = command.example;
            self.say(format_args!("expected: {command}, such as: {example}"));
        } else if let Some(name) = nearest(COMMANDS, word) {
            self.say(format_args!("did you mean `{name}`?"));
        }
    }

    /// Returns true if all fingers have reported their state and positions.
    pub(super) fn sees_all(&self) -> bool {
        let count = self.hand.fingers.len();
        let measured = with(self.shared, |drive| {
            let mut fingers = drive.measured.iter().take(count);
            fingers.all(Option::is_some)
        });
        measured == Some(true) && (0..count).all(|finger| self.servos.status(finger).is_some())
    }

    /// Looks at the servos. All motion stops when a finger does not follow any more.
    pub(super) fn watch(&mut self) -> Result<(), ProgramError> {
        self.servos.watch(said(self.background))?;
        self.stop_if_lost();
        Ok(())
    }

    /// Stops all motion if a finger has been lost since it was looked for.
    fn stop_if_lost(&mut self) {
        if self.servos.take_lost() && self.stop(RefusalReason::Failure) {
            self.say(format_args!("all motion stops"));
        }
    }

    /// Goes on with the motion that runs, and with those that wait.
    pub(super) fn play(&mut self) {
        let say = said(self.background);
        match self.requests.attend() {
            Ok(Some(MotionsEvent::Aborted)) if self.stop(RefusalReason::Command) => {
                say(format_args!("all motion stops"));
            }
            Ok(Some(MotionsEvent::Taken(session))) => {
                say(format_args!(
                    "another program is in control, by session {session}"
                ));
            }
            Ok(Some(MotionsEvent::Gone(session))) => say(format_args!(
                "the program of session {session} has ended: no program is in control"
            )),
            Ok(_) => {}
            Err(problem) => say(format_args!("{problem}")),
        }
        if let Some((title, mut state, mut reason)) = self.player.play(self.hand, self.shared, &say)
        {
            // One that holds at its end does not hold the next one.
            with(self.shared, |drive| drive.generator.proceed());
            // A finger that was lost on the way, and that nobody has looked at since, was not there.
            let is_watched = self.servos.watch(&say).is_ok();
            if !is_watched || self.servos.has_lost() {
                (state, reason) = (RequestState::Aborted, RefusalReason::Failure);
            }
            if state == RequestState::Aborted {
                self.follow.cancel(self.shared);
                say(format_args!("{title} was not completed: {reason}"));
            } else {
                self.follow.end(self.shared);
                say(format_args!("{title} is done"));
            }
            if let Err(error) = self.requests.server.end(state, reason) {
                say(format_args!("{}", Problem::from(error)));
            }
            self.stop_if_lost();
        }
        if let Err(problem) = self.begin_next() {
            say(format_args!("{problem}"));
        }
        (self.requests.server).tell_progress(self.player.done(self.shared));
        self.follow.look(&self.servos, self.hand, &say);
        if let Err(problem) = self.close() {
            say(format_args!("{problem}"));
        }
    }

    /// Begins the next motion of the queue, if none runs.
    fn begin_next(&mut self) -> Result<(), Problem<'static>> {
        let Some((identity, work)) = self.requests.server.next_request() else {
            return Ok(());
        };
        let mut title = Title::new();
        // One that is too long is cut.
        let _ = match (&work.title, work.name()) {
            (Some(name), _) => write!(title, "{name}"),
            (None, Some(name)) => write!(title, "{name}"),
            (None, None) if work.stream.is_some() => {
                write!(title, "stream {}.{}", identity.session, identity.number)
            }
            (None, None) => write!(title, "motion {}.{}", identity.session, identity.number),
        };
        let fingers = match self.prepare(&work) {
            Ok(fingers) => fingers,
            Err(problem) if problem.is_passing() => {
                // The request waits, and nothing else moves meanwhile.
                self.player.stop();
                return Err(problem);
            }
            Err(problem) => return self.refuse_next(identity, &title, &problem),
        };
        // A stream begins from rest, and nothing before another one has come to its rest.
        let is_free = with(self.shared, |drive| drive.is_free(work.stream.is_some()));
        if is_free != Some(true) || !self.requests.server.begin()? {
            return Ok(());
        }
        if let Some(mask) = work.stream {
            let owner = self.requests.owner(identity.session);
            let limits = self.player.limits();
            let begun = with(self.shared, |drive| {
                drive.begin_stream(identity, owner.unwrap_or_default(), mask, limits)
            });
            return match begun {
                Some(Ok(())) => {
                    self.player.begin_stream(title, fingers);
                    Ok(())
                }
                _ => Ok(self
                    .requests
                    .server
                    .end(RequestState::Aborted, RefusalReason::FromHere)?),
            };
        }
        if let Err(error) = self.player.begin(&title, fingers) {
            self.player.stop();
            (self.requests.server).end(RequestState::Aborted, RefusalReason::NoMotion)?;
            return Err(Problem::Recording(error));
        }
        // Nobody compares the tracking errors of a single joint that a command moves.
        if work.title.is_none() {
            let is_named = work.name().is_some();
            (self.follow).begin(self.shared, identity, &title, is_named);
        }
        Ok(())
    }

    /// Refuses the request whose turn has come, and says why.
    fn refuse_next(
        &mut self,
        identity: RequestIdentity,
        title: &Title,
        problem: &Problem<'_>,
    ) -> Result<(), Problem<'static>> {
        if self.requests.is_own(identity.session) {
            self.say(format_args!("{problem}"));
        } else {
            self.say(format_args!("refused {title}: {problem}"));
        }
        self.player.stop();
        Ok(self.requests.server.refuse(problem.reason())?)
    }

    /// Puts the motions of a request where they run from, and checks them. Returns a bit for each
    /// finger that they move.
    fn prepare(&mut self, work: &Work) -> Result<u32, Problem<'static>> {
        if let Some(mask) = work.stream {
            self.numbers
                .check(mask)
                .map_err(|joint| Problem::NoSuchJoint { joint })?;
            let fingers = self.numbers.fingers(mask);
            self.check_follows(fingers)?;
            return Ok(fingers);
        }
        match work.name() {
            Some(_) if work.is_kept => {
                self.player.is_recording = false;
                self.player.take_kept();
            }
            Some(name) => self.store.load(name, self.player.room())?,
            None => {
                let room = self.player.room();
                room.set(work.image()).map_err(Problem::Recording)?;
            }
        }
        let fingers = self.player.fingers(self.hand)?;
        self.check_follows(fingers)?;
        Ok(fingers)
    }

    fn help<'l>(&mut self, words: &mut Words<'l>) -> Result<(), Problem<'l>> {
        let Some(word) = words.next() else {
            for command in COMMANDS {
                self.say(format_args!("{}", Line(command)));
            }
            return Ok(());
        };
        words.end()?;
        let command = find(COMMANDS, word).ok_or(Problem::Command(word))?;
        self.say(format_args!("{command}: {}", command.about));
        self.say(format_args!("example: {}", command.example));
        Ok(())
    }

    fn enable<'l>(&mut self, words: &mut Words<'l>) -> Result<(), Problem<'l>> {
        self.each_finger(words, Servos::enable)
    }

    fn control<'l>(&mut self, words: &mut Words<'l>) -> Result<(), Problem<'l>> {
        words.end()?;
        self.requests.take_control(true)
    }

    fn motions<'l>(&mut self, words: &mut Words<'l>) -> Result<(), Problem<'l>> {
        words.end()?;
        let say = said(self.background);
        self.store.list(|name| say(format_args!("{name}")))
    }

    fn pause<'l>(&mut self, words: &mut Words<'l>) -> Result<(), Problem<'l>> {
        words.end()?;
        with(self.shared, |drive| {
            drive.generator.pause();
            drive.abort_stream();
        });
        Ok(())
    }

    fn resume<'l>(&mut self, words: &mut Words<'l>) -> Result<(), Problem<'l>> {
        words.end()?;
        with(self.shared, |drive| {
            drive.generator.resume();
            drive.generator.proceed();
        });
        Ok(())
    }

    fn abort<'l>(&mut self, words: &mut Words<'l>) -> Result<(), Problem<'l>> {
        words.end()?;
        if !self.stop(RefusalReason::Command) {
            self.say(format_args!("no motion runs"));
        }
        Ok(())
    }

    fn record<'l>(&mut self, words: &mut Words<'l>) -> Result<(), Problem<'l>> {
        let name = words.name()?;
        words.end()?;
        self.requests.check_kept()?;
        self.player.kept.clear();
        self.player.name_kept(name);
        self.player.is_recording = true;
        Ok(())
    }

    /// A motion, or the program of a processor if there are more words.
    fn load<'l>(&mut self, words: &mut Words<'l>) -> Result<(), Problem<'l>> {
        if words.peek().nth(1).is_some() {
            let processor = words.word("a processor")?;
            return self.load_program(processor, words);
        }
        let name = words.name()?;
        self.requests.check_kept()?;
        self.player.is_recording = false;
        self.store.load(name, &mut self.player.kept)?;
        self.player.name_kept(name);
        let count = self.player.kept.motions().map_or(0, |it| it.len());
        self.say(format_args!("{name}: {count} motions; `run` runs them"));
        Ok(())
    }

    fn release<'l>(&mut self, words: &mut Words<'l>) -> Result<(), Problem<'l>> {
        words.end()?;
        self.requests.check_free()?;
        self.closing = None;
        self.order(&GraspOrder::RELEASE)
    }

    fn letgo<'l>(&mut self, words: &mut Words<'l>) -> Result<(), Problem<'l>> {
        let seconds = words.maybe_within("a time, s", NumberRange::LET_GO)?;
        let seconds = seconds.unwrap_or(1.0);
        words.end()?;
        self.plant(
            plant::PlantOperation::LetGo,
            [seconds, 0.0, 0.0, 0.0, 0.0, 0.0],
        )
    }

    fn push<'l>(&mut self, words: &mut Words<'l>) -> Result<(), Problem<'l>> {
        let force = words.three_within("a force, N", NumberRange::FORCE)?;
        let moment = match words.peek().next() {
            None => [0.0; 3],
            Some(_) => words.three_within("a moment, N m", NumberRange::MOMENT)?,
        };
        words.end()?;
        let wrench = [force, moment];
        let numbers = wrench.as_flattened().try_into();
        // There are six.
        self.plant(plant::PlantOperation::Push, numbers.unwrap_or([0.0; 6]))
    }

    fn clear<'l>(&mut self, words: &mut Words<'l>) -> Result<(), Problem<'l>> {
        words.end()?;
        self.plant(plant::PlantOperation::Mend, [0.0; 6])
    }

    fn say(&self, line: Arguments<'_>) {
        said(self.background)(line);
    }

    fn status<'l>(&mut self, words: &mut Words<'l>) -> Result<(), Problem<'l>> {
        words.end()?;
        let mut titles: Option<Titles<'_>> = None;
        for (finger, entry) in self.hand.fingers.iter().enumerate() {
            if !titles.as_ref().is_some_and(|titles| titles.suit(entry)) {
                self.say(format_args!("{}", titles.insert(Titles(entry))));
            }
            let measured = with(self.shared, |drive| {
                drive.measured.get(finger).copied().flatten()
            });
            let row = Row {
                finger: entry,
                status: self.servos.status(finger),
                processor: self.servos.processor(finger),
                measured: measured.flatten(),
            };
            self.say(format_args!("{row}"));
        }
        for (finger, entry) in self.hand.fingers.iter().enumerate() {
            if let Some(status) = self.servos.status(finger)
                && let Some(mixed) = MixedModes::of(entry, status)
            {
                self.say(format_args!("{mixed}"));
            }
        }
        for (finger, entry) in self.hand.fingers.iter().enumerate() {
            if let Some(fault) = self.servos.status(finger).and_then(|status| status.fault) {
                self.say(format_args!("fault of {}: {fault}", entry.name));
            }
        }
        if let Some(resting @ 1..) = self.others.resting() {
            let boards = Boards(resting);
            self.say(format_args!(
                "D/A boards at rest with the least tensions, since no values come: {boards}"
            ));
        }
        let failed = self.others.failed();
        if failed.is_some() {
            self.say(format_args!(
                "the robot is simulated without collisions: its fingers can pass through each other"
            ));
        }
        if let Some(failed @ 1..) = failed {
            self.say(format_args!(
                "the simulated robot has failed in {failed} ticks, as its terminal explains; `clear` puts it back to \
                 its start"
            ));
        }
        let is_paused = with(self.shared, |drive| drive.generator.is_paused());
        let paused = if is_paused == Some(true) {
            ", paused"
        } else {
            ""
        };
        match self.player.title() {
            Some(title) => {
                let (next, count) = self.player.progress();
                self.say(format_args!(
                    "motion {title}: {next} of {count} begun{paused}"
                ));
            }
            None => self.say(format_args!("no motion{paused}")),
        }
        let (waiting, in_control) = self.requests.waiting();
        if waiting > 0 {
            self.say(format_args!("{waiting} motions wait"));
        }
        if let Some(session) = in_control.filter(|&it| !self.requests.is_own(it)) {
            self.say(format_args!(
                "another program is in control, by session {session}"
            ));
        }
        if !self.player.kept.is_empty() || self.player.is_recording {
            let count = self.player.kept.motions().map_or(0, |it| it.len());
            let what = if self.player.is_recording {
                "recording"
            } else {
                "in memory"
            };
            self.say(format_args!(
                "{what}: {}, {count} motions",
                self.player.kept_title
            ));
        }
        match self.others.see(self.background) {
            Ok(object) => self.say(format_args!("object: {}", MeasuredObject(&object))),
            Err(problem) => self.say(format_args!("object: {problem}")),
        }
        match self.ask_table(table::TableOperation::Status, 1.0, [0.0; 3]) {
            Ok(state) => self.say(format_args!("table: {state}")),
            Err(problem) => self.say(format_args!("table: {problem}")),
        }
        Ok(())
    }

    /// Stops all motion on its path; whether there was any.
    fn stop(&mut self, reason: RefusalReason) -> bool {
        self.player.stop();
        self.follow.cancel(self.shared);
        // First the hand, then what is written about it.
        let was_busy = with(self.shared, |drive| {
            let was_busy = drive.abort_stream() || !drive.generator.is_idle();
            drive.generator.abort();
            // A paused motion would never come to its stop.
            drive.generator.resume();
            was_busy
        });
        if let Err(error) = self.requests.server.abort(reason) {
            self.say(format_args!("{}", Problem::from(error)));
        }
        was_busy.unwrap_or(false)
    }

    /// Switches fingers off, and stops what moves one of them.
    fn disable<'l>(&mut self, words: &mut Words<'l>) -> Result<(), Problem<'l>> {
        let outcome = self.each_finger(words, Servos::disable);
        let is_moved = |finger| self.player.moves(finger) && !self.servos.follows(finger);
        if (0..FINGERS).any(is_moved) && self.stop(RefusalReason::Command) {
            self.say(format_args!("all motion stops"));
        }
        outcome
    }

    fn each_finger<'l>(
        &mut self,
        words: &mut Words<'l>,
        mut work: impl FnMut(&mut Servos<'r, 'p, M>, usize) -> Result<(), Problem<'static>>,
    ) -> Result<(), Problem<'l>> {
        let only = words.finger(self.hand)?;
        words.end()?;
        let mut outcome = Ok(());
        let fingers = 0..self.hand.fingers.len();
        for finger in fingers.filter(|&it| only.is_none_or(|only| only == it)) {
            let done = work(&mut self.servos, finger);
            if only.is_some() {
                outcome = done;
            } else if let Err(problem) = done {
                // One that cannot does not keep the others from it.
                self.say(format_args!("{problem}"));
            }
        }
        outcome
    }

    /// Checks that all fingers of a mask follow.
    fn check_follows(&self, fingers: u32) -> Result<(), Problem<'static>> {
        for (finger, entry) in self.hand.fingers.iter().enumerate() {
            if fingers >> finger & 1 == 0 || self.servos.follows(finger) {
                continue;
            }
            let name = entry.name.clone();
            let Some(status) = self.servos.status(finger) else {
                return Err(Problem::NotEnabled(name));
            };
            let modes = status.modes.iter().zip(&entry.joints);
            let other = modes
                .filter(|_| status.fault.is_none() && !status.is_resting)
                .find(|(mode, _)| **mode != ServoMode::Position);
            return Err(match other {
                _ if status.modes.contains(&ServoMode::Grasp) => Problem::InGrasp(name),
                Some((mode, joint)) if !are_all(status, entry.joints.len(), ServoMode::Off) => {
                    Problem::OtherMode {
                        finger: name,
                        joint: joint.name.clone(),
                        mode: mode.name(),
                    }
                }
                _ => Problem::NotEnabled(name),
            });
        }
        Ok(())
    }

    fn run<'l>(&mut self, words: &mut Words<'l>) -> Result<(), Problem<'l>> {
        let mut rest = words.peek();
        let work = if rest.next().is_some() {
            let name = words.name()?;
            words.end()?;
            Work::named(name, false)
        } else if self.player.kept.is_empty() {
            return Err(Problem::Nothing);
        } else {
            self.player.is_recording = false;
            Work::named(&self.player.kept_title, true)
        };
        self.enqueue(work)
    }

    /// Enqueues what was typed, and begins it if nothing else runs.
    fn enqueue(&mut self, work: Work) -> Result<(), Problem<'static>> {
        let is_first = self.player.title().is_none();
        self.requests.enqueue(work)?;
        if is_first {
            return self.begin_next();
        }
        let (waiting, _) = self.requests.waiting();
        self.say(format_args!("the motion waits: {waiting} in the queue"));
        Ok(())
    }

    fn to<'l>(&mut self, words: &mut Words<'l>) -> Result<(), Problem<'l>> {
        let (finger, joint) = words.joint(self.hand)?;
        let position = words.number("a position, rad")?;
        let seconds = words.positive(SECONDS)?;
        words.end()?;
        let pace = seconds.map_or(Pace::Speed(0.1), Pace::Duration);
        let mut motion = Motion::new(pace, Profile::MinimumJerk).with(
            self.numbers.number(finger, joint),
            Target::Absolute(position),
        )?;
        motion.begin = Begin::Beside;
        let mut image = [0; BODY_BYTES];
        let len = encode_for(self.numbers.count(), [&motion], &mut image);
        let len = len.map_err(Problem::Recording)?;
        let mut title = Title::new();
        let entry = self.hand.fingers.get(finger);
        if let Some((entry, joint)) = entry.and_then(|it| Some((it, it.joints.get(joint)?))) {
            // One that is too long is cut.
            let _ = write!(title, "{}.{}", entry.name, joint.name);
        }
        let work = Work::of_image(image.get(..len).unwrap_or(&[]), title);
        self.enqueue(work.ok_or(Problem::Nothing)?)
    }

    fn save<'l>(&mut self, words: &mut Words<'l>) -> Result<(), Problem<'l>> {
        let mut rest = words.peek();
        if rest.next().is_some() {
            let name = words.name()?;
            words.end()?;
            self.player.name_kept(name);
        }
        if self.player.kept.is_empty() {
            return Err(Problem::Nothing);
        }
        let title = self.player.kept_title.clone();
        self.store.save(&title, &self.player.kept)?;
        self.player.is_recording = false;
        let count = self.player.kept.motions().map_or(0, |it| it.len());
        self.say(format_args!("{title}: {count} motions saved"));
        Ok(())
    }

    fn table<'l>(&mut self, words: &mut Words<'l>) -> Result<(), Problem<'l>> {
        let mut rest = words.peek();
        let operation = match rest.next() {
            None => Some(table::TableOperation::Status),
            Some("home") => Some(table::TableOperation::Home),
            Some("stop") => Some(table::TableOperation::Stop),
            Some("off") => Some(table::TableOperation::Disable),
            Some("clear") => Some(table::TableOperation::Clear),
            Some(_) => None,
        };
        let state = if let Some(operation) = operation {
            words.next();
            words.end()?;
            self.ask_table(operation, 0.2, [0.0; 3])?
        } else {
            let to = words.three("a position, m")?;
            let speed = words.positive("a speed above 0, at most 1")?;
            words.end()?;
            self.ask_table(table::TableOperation::Move, speed.unwrap_or(0.2), to)?
        };
        self.say(format_args!("table: {state}"));
        Ok(())
    }

    fn ask_table(
        &mut self,
        operation: table::TableOperation,
        speed: f64,
        to: [f64; 3],
    ) -> Result<TableStatus, Problem<'static>> {
        self.others.table(&table::TableRequest {
            operation: operation as u32,
            zero: 0,
            speed,
            to,
        })
    }

    fn ball<'l>(&mut self, words: &mut Words<'l>) -> Result<(), Problem<'l>> {
        if words.peek().next() == Some("none") {
            words.next();
            words.end()?;
            return self.plant(plant::PlantOperation::RemoveBall, [0.0; 6]);
        }
        let former = self.others.ball;
        let radius = words.maybe_within("a radius, m", NumberRange::RADIUS)?;
        let mass = words.maybe_within("a mass, kg", NumberRange::MASS)?;
        let center = match words.peek().next() {
            None => former.center,
            Some(_) => words.three_within("a position, m", NumberRange::PLACE)?,
        };
        words.end()?;
        let ball = Ball {
            center,
            radius: radius.unwrap_or(former.radius),
            mass: mass.unwrap_or(former.mass),
        };
        let [x, y, z] = ball.center;
        self.plant(
            plant::PlantOperation::PlaceBall,
            [x, y, z, ball.radius, ball.mass, 0.0],
        )?;
        self.others.ball = ball;
        Ok(())
    }

    fn fault<'l>(&mut self, words: &mut Words<'l>) -> Result<(), Problem<'l>> {
        let (finger, joint) = words.joint(self.hand)?;
        let what = "position, flexor or extensor";
        let word = words.word(what)?;
        words.end()?;
        let (operation, which) = match word {
            "position" => (plant::PlantOperation::StickSensor, PlantTarget::Position),
            "flexor" => (plant::PlantOperation::CutTendon, PlantTarget::Flexor),
            "extensor" => (plant::PlantOperation::CutTendon, PlantTarget::Extensor),
            _ => return Err(Problem::Not { word, what }),
        };
        self.others.plant(&plant::PlantRequest {
            operation: operation as u32,
            finger: finger as u32,
            joint: joint as u32,
            which: which as u32,
            numbers: [0.0; 6],
        })
    }

    fn plant(
        &mut self,
        operation: plant::PlantOperation,
        numbers: [f64; 6],
    ) -> Result<(), Problem<'static>> {
        self.others.plant(&plant::PlantRequest {
            operation: operation as u32,
            numbers,
            ..plant::PlantRequest::default()
        })
    }
}
