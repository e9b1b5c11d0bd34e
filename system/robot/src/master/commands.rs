//! [`Commands`]: what is typed.

use core::fmt::{Arguments, Display, Write as _};

use condor_hand::decimal::Decimal;
use condor_hand::grasp::distributed::{GraspOrder, GraspSettings};
use condor_hand::servo::ServoMode;
use condor_hand::trajectory::Pace;
use condor_mbox::{Allocator, Instant};
use condor_rt::{Background, Machine, ProgramError};

use super::drive::{SharedDrive, with};
use super::follow::Follow;
use super::others::Others;
use super::play::{Player, Title, check};
use super::queue::{JointMove, Requests, Work};
use super::sequence::Store;
use super::servos::{Servos, are_all};
use super::words::{MotionName, Problem, Words, names};
use crate::joints::{JointName, JointNumbers};
use crate::master::Prompted;
use crate::motions::MotionsEvent;
use crate::plant::NumberRange;
use crate::queue::{InControl, OWN, RefusalReason, RequestIdentity, RequestState};
use crate::table::TableRequest;
use crate::{FINGERS, RobotDescription, grasp};

mod complete;
mod gains;
mod hold;
mod list;
mod modes;
mod processors;
mod shown;
mod simulate;
mod status;
mod teach;
mod watch;

use list::{Command, Group, Line, commands, find, nearest};
pub(super) use processors::Processors;
pub(super) use watch::Watching;

commands! {
    "look": "shows the robot and what can be run" {
        "help" "[GROUP|COMMAND]" "lists the commands, or explains some" "help to" help
            "Tab completes the word that is being typed; Up brings back the line before.";
        "status" "" "shows fingers, motion, object and table" "status" status
            "Faults are shown with what can be done about them.";
        "watch" "[FINGER|FINGER.JOINT]..." "shows joints live, until a key is typed" "watch index thumb.distal"
            watch_joints "Without a name it shows the joints that were named last.";
        "motions" "" "lists the motions that `run` knows" "motions" motions
            "They are the files of the directory `motions`.";
    }
    "hold": "makes fingers hold their positions, or lets them go" {
        "enable" "[FINGER]" "makes fingers hold where they are" "enable index" enable
            "Without a name: all fingers. It clears faults.";
        "disable" "[FINGER]" "lets go: no torque of the joints" "disable index" disable
            "Without a name: all fingers. It ends a motion that moves one of them.";
        "control" "" "takes control from another program" "control" control
            "Only one program at a time moves the robot, such as the page or this terminal.";
    }
    "move": "moves the robot; `enable` first" {
        "run" "[MOTION]" "runs a motion, or the one in memory" "run wave" run
            "`motions` lists them; `record` and `open` put one into memory. If another one runs, it waits.";
        "to" "FINGER.JOINT RAD [SECONDS]" "moves one joint to a position" "to index.middle 0.9 0.5" to
            "RAD: within the limits of the joint. SECONDS: above 0; by default at a tenth of its largest speed.";
        "pause" "" "slows the motion down to a stop" "pause" pause "`resume` goes on with it.";
        "resume" "" "goes on with the motion that is paused" "resume" resume "";
        "abort" "" "ends all motion; so does Ctrl-C" "abort" abort "The joints hold where they come to rest.";
    }
    "modes": "sets how joints are controlled; `enable` first" {
        "mode" "FINGER[.JOINT] MODE" "sets the mode; joints keep their state" "mode index impedance" mode
            "MODE: off, effort, torque, position or impedance. `enable` goes back to positions.";
        "torque" "FINGER.JOINT NM" "sets the torque of a joint" "torque index.middle 0.05" torque
            "NM: the torque of its actuators, N m. Nothing else bears the weight of the links.";
        "effort" "FINGER.ACTUATOR N" "sets the effort of an actuator" "effort index.middle-flexor 8" effort
            "N: within the range of the actuator; N m if it is a motor that turns a joint.";
        "impedance" "FINGER[.JOINT] NM_PER_RAD [NM_S_PER_RAD [RAD]]" "acts as a spring" "impedance index 0.05" impedance
            "Stiffness, damping, and the position at rest, by default the present one.";
        "gains" "FINGER.PART [GAIN VALUE]..." "shows or sets gains, filters and limits"
            "gains index.middle servo.zeta 1" gains
            "PART is a joint or an actuator. A value out of its range is refused with the range.";
    }
    "teach": "records motions, and keeps them in files" {
        "record" "MOTION" "records what is run until `save`" "record mine" record
            "Each motion that begins becomes a part of MOTION; `run` without a name ends it.";
        "save" "[MOTION]" "saves the motion in memory in a file" "save mine" save
            "By default under the name that it has. A file that is there stays.";
        "open" "MOTION" "takes a motion from its file into memory" "open wave" open
            "`run` runs it then, and `save` can save it under another name.";
    }
    "object": "grasps a ball, and moves the table" {
        "grasp" "[N/M|STIFFNESS]" "closes the fingers on the ball" "grasp 150" grasp
            "Needs a ball (`ball`) and three enabled fingers. STIFFNESS: a file of the directory `grasps`.";
        "release" "" "ends the grasp" "release" release "The fingers hold where they are.";
        "table" "[home|stop|off|clear|X Y Z [SPEED]]" "moves the palm to X Y Z, m" "table 0.05 0 -0.02 0.5" table
            "`table home` first. SPEED: a part of the largest speed, above 0, at most 1; by default 0.2.";
    }
    "simulate": "changes the simulated robot" {
        "ball" "[none|RADIUS [MASS [X Y Z]]]" "adds a ball, held until `letgo`" "ball 0.02 0.05" ball
            "RADIUS: 0.005 to 0.04 m. MASS: 0.001 to 1 kg. X, Y, Z: -0.3 to 0.3 m, of the palm.";
        "letgo" "[SECONDS]" "leaves the ball to the fingers alone" "letgo 1" letgo
            "SECONDS: 0 to 60, within which its support vanishes.";
        "push" "X Y Z [X Y Z]" "pushes the ball until the next push" "push 0.2 0 0" push
            "Force: -20 to 20 N. Moment: -1 to 1 N m.";
        "weight" "FINGER KG" "hangs a weight on a fingertip" "weight index 0.1" weight
            "KG: 0 to 1 kg; 0 takes it away.";
        "fault" "FINGER.PART position|effort|drive" "breaks a sensor or a drive" "fault thumb.distal position"
            fault "A joint has a position, an actuator an effort and a drive. `clear` mends it.";
        "clear" "" "mends what is broken" "clear" clear
            "If the simulation has failed, it is at its start again. Otherwise the ball stays where it is.";
    }
    "programs": "restarts and replaces programs of processors" {
        "restart" "PROCESSOR" "restarts the program of a processor" "restart 1" restart
            "PROCESSOR: its name or its number.";
        "load" "PROCESSOR PROGRAM [WORD]..." "runs another program there" "load servo-a self servo" load
            "PROGRAM: `self`, or one that the description names. The WORDs are its arguments.";
    }
}

/// The most motions that are listed in the order of their names.
const LISTED: usize = 64;
const SECONDS: &str = "a time above 0, s";
const SPEED: &str = "a speed above 0, at most 1";

/// The beginning of a line that says why something is not done.
const ERROR: &str = "error: ";

/// The state that commands share.
pub(super) struct Commands<'r, 'p, M: Machine> {
    pub(super) hand: &'r RobotDescription,
    pub(super) numbers: JointNumbers,
    pub(super) background: &'r Background<'r, M>,
    pub(super) prompted: &'r Prompted,
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

/// Returns a function that says a line on the terminal, in the place of the prompt if that is shown.
pub(super) fn said<'r, M: Machine>(
    background: &'r Background<'r, M>,
    prompted: &'r Prompted,
) -> impl Fn(Arguments<'_>) + 'r {
    |line| {
        let begin = if prompted.take() { "\r\x1b[K" } else { "" };
        background.print(format_args!("{begin}{line}\n"));
    }
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
            return self.complain(problem);
        };
        self.say(format_args!("{ERROR}word {number}: {problem}"));
        if let Some(command) = find(GROUPS, word) {
            let example = command.example;
            self.say(format_args!("expected: {command}, such as: {example}"));
        } else if let Some(name) = nearest(GROUPS, word) {
            self.say(format_args!("did you mean `{name}`?"));
        }
    }

    /// Says why something is not done.
    fn complain(&self, problem: &impl Display) {
        self.say(format_args!("{ERROR}{problem}"));
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
        self.servos.watch(said(self.background, self.prompted))?;
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
        let say = said(self.background, self.prompted);
        match self.requests.attend() {
            Ok(Some(MotionsEvent::Aborted)) if self.stop(RefusalReason::Command) => {
                say(format_args!("all motion stops"));
            }
            Ok(Some(MotionsEvent::Taken(session))) => {
                say(format_args!("{}", InControl::Session(session)));
            }
            Ok(Some(MotionsEvent::Gone(session))) => say(format_args!(
                "the program of session {session} has ended: no program is in control"
            )),
            Ok(_) => {}
            Err(problem) => say(format_args!("{ERROR}{problem}")),
        }
        if let Some(problem) = self.requests.take_refused() {
            say(format_args!(
                "a motion that another program has sent is refused: {problem}"
            ));
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
                say(format_args!("{ERROR}{}", Problem::from(error)));
            }
            self.stop_if_lost();
        }
        if let Err(problem) = self.begin_next() {
            say(format_args!("{ERROR}{problem}"));
        }
        (self.requests.server).tell_progress(self.player.done(self.shared));
        self.follow.look(&self.servos, self.hand, &say);
        if let Err(problem) = self.close() {
            say(format_args!("{ERROR}{problem}"));
        }
    }

    /// Begins the next motion of the queue, if none runs.
    fn begin_next(&mut self) -> Result<(), Problem<'static>> {
        let Some((identity, work)) = self.requests.server.next_request() else {
            return Ok(());
        };
        let mut title = Title::new();
        let RequestIdentity { session, number } = identity;
        // One that is too long is cut.
        let _ = match &work {
            Work::Named(name) | Work::Kept(name) => write!(title, "{name}"),
            Work::Joint(one) => write!(title, "{}", JointName(self.hand, one.joint)),
            Work::Motions(..) => write!(title, "motion {session}.{number}"),
            Work::Stream(_) => write!(title, "stream {session}.{number}"),
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
        let is_stream = matches!(work, Work::Stream(_));
        let is_free = with(self.shared, |drive| drive.is_free(is_stream));
        if is_free != Some(true) || !self.requests.server.begin()? {
            return Ok(());
        }
        if let Work::Stream(mask) = work {
            let owner = self.requests.owner(identity);
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
        if self.player.begin(title.clone(), fingers).is_err() {
            self.player.stop();
            (self.requests.server).end(RequestState::Aborted, RefusalReason::NoMotion)?;
            return Err(Problem::Full(self.player.kept_title.clone()));
        }
        if let Work::Joint(one) = &work {
            let to = Decimal(one.position);
            self.say(format_args!("{title} goes to {to} rad"));
        } else {
            if identity.session == OWN {
                self.say(format_args!("{title} runs"));
            }
            // Nobody compares the tracking errors of a single joint that a command moves.
            let is_named = matches!(work, Work::Named(_) | Work::Kept(_));
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
        if identity.session == OWN {
            self.complain(problem);
        } else {
            self.say(format_args!("{ERROR}refused {title}: {problem}"));
        }
        self.player.stop();
        Ok(self.requests.server.refuse(problem.reason())?)
    }

    /// Puts the motions of a request where they run from, and checks them. Returns a bit for each
    /// finger that they move.
    fn prepare(&mut self, work: &Work) -> Result<u32, Problem<'static>> {
        let fingers = match work {
            Work::Named(name) => {
                self.store.load(name, self.player.room())?;
                self.player.fingers(self.hand)?
            }
            Work::Kept(_) => {
                self.player.is_recording = false;
                self.player.take_kept();
                self.player.fingers(self.hand)?
            }
            Work::Joint(one) => {
                self.player.put(one.motion()?);
                self.numbers.fingers(1 << one.joint)
            }
            Work::Motions(image, fingers) => {
                self.player.room().set(image);
                *fingers
            }
            Work::Stream(mask) => self.numbers.fingers(*mask),
        };
        self.check_follows(fingers)?;
        Ok(fingers)
    }

    fn help<'l>(&mut self, words: &mut Words<'l>) -> Result<(), Problem<'l>> {
        let word = words.next();
        words.end()?;
        let Some(word) = word else {
            for group in GROUPS {
                self.say(format_args!("{group}"));
            }
            self.say(format_args!(
                "`help GROUP` tells what its commands do, `help COMMAND` how to type one"
            ));
            return Ok(());
        };
        if let Some(command) = find(GROUPS, word) {
            self.say(format_args!("{command}: {}", command.about));
            let mut rest = command.more;
            while !rest.is_empty() {
                // A sentence ends at a dot with a blank behind it, or at the end.
                let mut pairs = rest.bytes().zip(rest.bytes().skip(1));
                let dot = pairs.position(|pair| pair == (b'.', b' '));
                let end = dot.map_or(rest.len(), |dot| dot.saturating_add(1));
                let (sentence, after) = rest.split_at_checked(end).unwrap_or((rest, ""));
                self.say(format_args!("{sentence}"));
                rest = after.get(1..).unwrap_or("");
            }
            self.say(format_args!("example: {}", command.example));
            return Ok(());
        }
        let group = GROUPS.iter().find(|group| group.name == word);
        let group = group.ok_or(Problem::Command(word))?;
        self.say(format_args!("{}: {}", group.name, group.about));
        for command in group.commands {
            self.say(format_args!("{}", Line(command)));
        }
        Ok(())
    }

    fn enable<'l>(&mut self, words: &mut Words<'l>) -> Result<(), Problem<'l>> {
        self.each_finger(words, "enabled, holding position", Servos::enable)
    }

    fn control<'l>(&mut self, words: &mut Words<'l>) -> Result<(), Problem<'l>> {
        words.end()?;
        self.requests.take_control(true)?;
        self.say(format_args!("this terminal is in control"));
        Ok(())
    }

    fn motions<'l>(&mut self, words: &mut Words<'l>) -> Result<(), Problem<'l>> {
        words.end()?;
        let say = said(self.background, self.prompted);
        let mut names = heapless::Vec::<MotionName, LISTED>::new();
        self.store.list(|name| {
            let Ok(mut moved) = MotionName::try_from(name) else {
                return say(format_args!("{name}"));
            };
            // Those of greater names move by one place.
            for there in &mut names {
                if moved < *there {
                    core::mem::swap(there, &mut moved);
                }
            }
            if let Err(last) = names.push(moved) {
                say(format_args!("{last}"));
            }
        })?;
        names.iter().for_each(|name| say(format_args!("{name}")));
        Ok(())
    }

    fn pause<'l>(&mut self, words: &mut Words<'l>) -> Result<(), Problem<'l>> {
        words.end()?;
        self.check_moves()?;
        let is_stream = with(self.shared, |drive| {
            let is_stream = drive.abort_stream();
            if !is_stream {
                drive.generator.pause();
            }
            is_stream
        });
        let text = match is_stream {
            Some(true) => "the stream of points ends: nobody can resume it",
            _ => "paused: `resume` goes on",
        };
        self.say(format_args!("{text}"));
        Ok(())
    }

    fn resume<'l>(&mut self, words: &mut Words<'l>) -> Result<(), Problem<'l>> {
        words.end()?;
        self.check_moves()?;
        with(self.shared, |drive| {
            drive.generator.resume();
            drive.generator.proceed();
        });
        self.say(format_args!("the motion goes on"));
        Ok(())
    }

    fn abort<'l>(&mut self, words: &mut Words<'l>) -> Result<(), Problem<'l>> {
        words.end()?;
        let text = if self.stop(RefusalReason::Command) {
            "all motion stops"
        } else {
            "no motion runs"
        };
        self.say(format_args!("{text}"));
        Ok(())
    }

    /// Returns an error if nothing moves the joints, and nothing is paused.
    fn check_moves(&self) -> Result<(), Problem<'static>> {
        let is_idle = with(self.shared, |drive| {
            drive.generator.is_idle() && !drive.generator.is_paused()
        });
        if self.player.title().is_none() && is_idle != Some(false) {
            return Err(Problem::NoMotion);
        }
        Ok(())
    }

    fn release<'l>(&mut self, words: &mut Words<'l>) -> Result<(), Problem<'l>> {
        words.end()?;
        self.requests.check_free()?;
        self.closing = None;
        let is_held = (0..FINGERS).any(|finger| self.is_in_grasp(finger));
        self.order(&GraspOrder::RELEASE)?;
        if !is_held {
            return Err(Problem::NoGrasp);
        }
        // The fingers have left the grasp by this order.
        for finger in 0..self.hand.fingers.len() {
            self.servos.refresh(finger)?;
        }
        self.say(format_args!(
            "the grasp has ended; the fingers hold where they are"
        ));
        Ok(())
    }

    fn say(&self, line: Arguments<'_>) {
        said(self.background, self.prompted)(line);
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
            self.say(format_args!("{ERROR}{}", Problem::from(error)));
        }
        was_busy.unwrap_or(false)
    }

    /// Switches fingers off, and stops what moves one of them.
    fn disable<'l>(&mut self, words: &mut Words<'l>) -> Result<(), Problem<'l>> {
        let outcome = self.each_finger(words, "disabled, without torque", Servos::disable);
        let is_moved = |finger| self.player.moves(finger) && !self.servos.follows(finger);
        if (0..FINGERS).any(is_moved) && self.stop(RefusalReason::Command) {
            self.say(format_args!("all motion stops"));
        }
        outcome
    }

    /// Does something with the finger that is named, or else with all, and says of which it `is` done.
    fn each_finger<'l>(
        &mut self,
        words: &mut Words<'l>,
        is: &str,
        mut work: impl FnMut(&mut Servos<'r, 'p, M>, usize) -> Result<(), Problem<'static>>,
    ) -> Result<(), Problem<'l>> {
        let only = words.finger(self.hand)?;
        words.end()?;
        let (mut done, mut absent) = (0, None);
        let fingers = 0..self.hand.fingers.len();
        for finger in fingers.filter(|&it| only.is_none_or(|only| only == it)) {
            match work(&mut self.servos, finger) {
                Ok(()) => done |= 1 << finger,
                Err(problem) if only.is_some() => return Err(problem),
                // The processor of several fingers is named once.
                Err(Problem::Absent(number)) if absent.replace(number) == Some(number) => {}
                // One that cannot does not keep the others from it.
                Err(problem) => self.complain(&problem),
            }
        }
        if done != 0 {
            let names = names(self.hand, done);
            self.say(format_args!("{names}: {is}"));
        }
        Ok(())
    }

    /// Checks that all fingers of a mask follow.
    fn check_follows(&self, fingers: u32) -> Result<(), Problem<'static>> {
        let mut missing = 0;
        for (finger, entry) in self.hand.fingers.iter().enumerate() {
            if fingers >> finger & 1 == 0 || self.servos.follows(finger) {
                continue;
            }
            let name = entry.name.clone();
            let Some(status) = self.servos.status(finger) else {
                missing |= 1 << finger;
                continue;
            };
            let modes = status.modes.iter().zip(&entry.joints);
            let other = modes
                .filter(|_| status.fault.is_none() && !status.is_resting)
                .find(|(mode, _)| **mode != ServoMode::Position);
            return Err(match other {
                _ if status.modes.contains(&ServoMode::Grasp) => Problem::InGrasp(name),
                Some((mode, joint)) if !are_all(status, ServoMode::Off) => Problem::OtherMode {
                    finger: name,
                    joint: joint.name.clone(),
                    mode: mode.name(),
                },
                _ => {
                    missing |= 1 << finger;
                    continue;
                }
            });
        }
        match missing {
            0 => Ok(()),
            missing => Err(Problem::NotEnabled(names(self.hand, missing))),
        }
    }

    fn run<'l>(&mut self, words: &mut Words<'l>) -> Result<(), Problem<'l>> {
        let mut rest = words.peek();
        let work = if rest.next().is_some() {
            let name = words.name()?;
            words.end()?;
            Work::Named(MotionName::try_from(name).map_err(|_| Problem::Name(name))?)
        } else if self.player.kept.is_empty() {
            return Err(Problem::Nothing);
        } else {
            self.player.is_recording = false;
            Work::Kept(self.player.kept_title.clone())
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
        self.say(format_args!(
            "the motion waits: it is number {waiting} in the queue"
        ));
        Ok(())
    }

    fn to<'l>(&mut self, words: &mut Words<'l>) -> Result<(), Problem<'l>> {
        let (finger, joint) = words.joint(self.hand)?;
        let position = words.number("a position, rad")?;
        let seconds = words.positive(SECONDS)?;
        words.end()?;
        let one = JointMove {
            joint: self.numbers.number(finger, joint),
            position,
            pace: seconds.map_or(Pace::Speed(0.1), Pace::Duration),
        };
        check(self.hand, [one.motion()?]).map_err(Problem::alone)?;
        self.enqueue(Work::Joint(one))
    }

    fn table<'l>(&mut self, words: &mut Words<'l>) -> Result<(), Problem<'l>> {
        let speed = 0.2;
        let request = match words.peek().next() {
            None => Some(TableRequest::Status),
            Some("home") => Some(TableRequest::Home { speed }),
            Some("stop") => Some(TableRequest::Stop),
            Some("off") => Some(TableRequest::Disable),
            Some("clear") => Some(TableRequest::Clear),
            Some(_) => None,
        };
        let request = if let Some(request) = request {
            words.next();
            request
        } else {
            let to = self.place_of_table(words)?;
            let word = words.peek().next().unwrap_or_default();
            let speed = words.positive(SPEED)?.unwrap_or(speed);
            if speed > 1.0 {
                return Err(Problem::Not { word, what: SPEED });
            }
            TableRequest::Move { to, speed }
        };
        words.end()?;
        let state = self.others.table(&request)?;
        self.say(format_args!("table: {state}"));
        Ok(())
    }

    /// The next three words as a position within the limits of the table, m.
    fn place_of_table<'l>(&self, words: &mut Words<'l>) -> Result<[f64; 3], Problem<'l>> {
        let mut to = [0.0; 3];
        let names = ["X of the table", "Y of the table", "Z of the table"];
        for (axis, (to, name)) in to.iter_mut().zip(names).enumerate() {
            let what = "a position, m";
            let entry = self.hand.table.as_ref().and_then(|it| it.axes.get(axis));
            *to = match entry.map(|entry| (entry.limits.low, entry.limits.high)) {
                Some((low, high)) => {
                    let unit = "m";
                    let range = NumberRange {
                        name,
                        unit,
                        low,
                        high,
                    };
                    words.within(what, range)?
                }
                None => words.number(what)?,
            };
        }
        Ok(to)
    }
}
