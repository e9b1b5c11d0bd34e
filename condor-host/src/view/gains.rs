//! The gains of a processor's servos, by names such as `index.proximal.kp`.

use std::time::Duration;

use condor_hand::message::{BLOCK_BYTES, ClientError, ServoClient, ServoPlaces};
use condor_hand::servo::{JointGains, PositionLaw};
use condor_hand::tendon::TensionGains;
use condor_mbox::linux::LinuxWindow;
use condor_mbox::{AccessError, MemoryWindow, Places, Processor, Region};

use super::variables::WatchError;
use super::{Post, View, ViewError};
use condor_rt::directory::{Entry, Kind};
use condor_rt::numbers::PROCESSORS;

/// How long a servo may take to do what it is asked.
const ANSWER: Duration = Duration::from_secs(2);
/// What a client must name although it sends no set-points and asks for no status.
const JOINTS: usize = 1;

/// Why gains cannot be read or set.
#[derive(Debug, thiserror::Error)]
#[non_exhaustive]
pub enum GainsError {
    /// The system.
    #[error(transparent)]
    View(#[from] ViewError),
    /// The names of the joints.
    #[error(transparent)]
    Variables(#[from] WatchError),
    /// Its directory names a place for servos where none can be.
    #[error("{processor} says that its servos `{}` have {} bytes from {:#x} on, where none can be", .entry.name.as_str(), .entry.len, .entry.offset)]
    NoPlace {
        /// The processor.
        processor: Processor,
        /// What its directory says.
        entry: Entry,
    },
    /// The servos.
    #[error("the servos of {processor}: {source}")]
    Servos {
        /// The processor.
        processor: Processor,
        /// What they answer.
        source: ClientError,
    },
}

/// Where a gain is.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Gain {
    /// Its name: finger, joint, gain.
    pub name: String,
    /// The finger, counted from 0 on its processor.
    pub finger: u32,
    /// The joint of the finger.
    pub joint: u32,
    /// Its unit.
    pub unit: &'static str,
    /// Its name without finger and joint.
    field: &'static str,
}

/// The servos of a processor.
pub struct Servos<'p> {
    processor: Processor,
    client: ServoClient<'p, Post, LinuxWindow, 0, JOINTS>,
    /// `finger.joint` for each joint, with the numbers of both.
    joints: Vec<(String, u32, u32)>,
}

impl View {
    /// The servos of `processor`; `None` if it has none. The view must have [joined](View::join).
    ///
    /// # Errors
    /// [`GainsError`].
    pub fn servos(&self, processor: Processor) -> Result<Option<Servos<'_>>, GainsError> {
        let entries = self.entries(processor, Kind::Servos)?;
        let Some(entry) = entries.first() else {
            return Ok(None);
        };
        let region = self.region(processor)?;
        let places = places(&region, entry).ok_or(GainsError::NoPlace {
            processor,
            entry: *entry,
        })?;
        let client = ServoClient::new(self.post(), processor, &region, places);
        let client = client.map_err(|source| ViewError::Memory { processor, source })?;
        let mut servos = Servos {
            processor,
            client,
            joints: Vec::new(),
        };
        let names = self.joint_names(processor)?;
        servos.name(&names)?;
        Ok(Some(servos))
    }

    /// The names `finger.joint` of the joints whose positions can be watched, in their order.
    fn joint_names(&self, processor: Processor) -> Result<Vec<String>, WatchError> {
        let Some(monitor) = self.monitor(processor)? else {
            return Ok(Vec::new());
        };
        let variables = monitor.variables()?;
        let joint = |name: &str| {
            let joint = name.strip_suffix(".position")?;
            (joint.split('.').count() == 2).then(|| joint.to_owned())
        };
        Ok(variables
            .iter()
            .filter_map(|(_, variable)| joint(&variable.name))
            .collect())
    }
}

/// The places of servos whose blocks end where their entry does.
fn places(region: &Region<LinuxWindow>, entry: &Entry) -> Option<ServoPlaces<0, JOINTS>> {
    let points = entry.len.checked_sub(PROCESSORS as u32 * BLOCK_BYTES)?;
    let blocks = entry.offset.checked_add(points)?;
    let laid_out = || -> Result<_, AccessError> {
        let mut places = Places::new(region.size());
        places.bytes(blocks as usize)?;
        ServoPlaces::new(&mut places, PROCESSORS as u8)
    };
    let places = laid_out().ok()?;
    (places.block(Processor(0)) == Some(blocks)).then_some(places)
}

impl Servos<'_> {
    /// Asks for the names of the fingers; joints without a name are numbers.
    fn name(&mut self, names: &[String]) -> Result<(), GainsError> {
        let mut finger = 0;
        loop {
            let hello = self.client.hello(finger, ANSWER);
            let hello = hello.map_err(|source| self.error(source))?;
            let of_finger = format!("{}.", hello.finger);
            let mut of_joints = names.iter().filter(|name| name.starts_with(&of_finger));
            for joint in 0..hello.joints {
                let name = of_joints.next().cloned();
                let name = name.unwrap_or_else(|| format!("{of_finger}{joint}"));
                self.joints.push((name, finger, joint));
            }
            finger += 1;
            if finger >= hello.fingers {
                return Ok(());
            }
        }
    }

    const fn error(&self, source: ClientError) -> GainsError {
        GainsError::Servos {
            processor: self.processor,
            source,
        }
    }

    /// All gains, with their values.
    ///
    /// # Errors
    /// [`GainsError::Servos`].
    pub fn all(&mut self) -> Result<Vec<(Gain, f64)>, GainsError> {
        let mut all = Vec::new();
        for (name, finger, joint) in self.joints.clone() {
            let mut gains = self.gains(finger, joint)?;
            for (field, unit, value) in fields(&mut gains) {
                let gain = Gain {
                    name: format!("{name}.{field}"),
                    finger,
                    joint,
                    unit,
                    field,
                };
                all.push((gain, *value));
            }
        }
        Ok(all)
    }

    /// Sets one gain, and leaves the others of its joint as they are; gives what it was.
    ///
    /// # Errors
    /// [`GainsError::Servos`].
    pub fn set(&mut self, gain: &Gain, to: f64) -> Result<Option<f64>, GainsError> {
        let mut gains = self.gains(gain.finger, gain.joint)?;
        let fields = fields(&mut gains);
        let field = fields.into_iter().find(|(name, ..)| *name == gain.field);
        let Some((_, _, value)) = field else {
            return Ok(None);
        };
        let before = core::mem::replace(value, to);
        let set = self
            .client
            .set_gains(gain.finger, gain.joint, &gains, ANSWER);
        set.map_err(|source| self.error(source))?;
        Ok(Some(before))
    }

    fn gains(&mut self, finger: u32, joint: u32) -> Result<JointGains, GainsError> {
        let gains = self.client.gains(finger, joint, ANSWER);
        gains.map_err(|source| self.error(source))
    }
}

/// Names, units and values.
fn fields(gains: &mut JointGains) -> Vec<(&'static str, &'static str, &mut f64)> {
    let mut fields = match &mut gains.law {
        PositionLaw::Pd {
            kp,
            kv,
            ki,
            integral_nm,
        } => vec![
            ("kp", "N m/rad", kp),
            ("kv", "N m s/rad", kv),
            ("ki", "N m/(rad s)", ki),
            ("integral_nm", "N m", integral_nm),
        ],
        PositionLaw::ComputedTorque {
            bandwidth_hz,
            damping_ratio,
        } => vec![
            ("bandwidth_hz", "Hz", bandwidth_hz),
            ("damping_ratio", "", damping_ratio),
        ],
    };
    fields.push(("k_torque", "", &mut gains.k_torque));
    let TensionGains { kt, ki, kd, kv } = &mut gains.tension.flexor;
    fields.extend([
        ("flexor.kt", "", kt),
        ("flexor.ki", "1/s", ki),
        ("flexor.kd", "s", kd),
        ("flexor.kv", "N s/m", kv),
    ]);
    let TensionGains { kt, ki, kd, kv } = &mut gains.tension.extensor;
    fields.extend([
        ("extensor.kt", "", kt),
        ("extensor.ki", "1/s", ki),
        ("extensor.kd", "s", kd),
        ("extensor.kv", "N s/m", kv),
    ]);
    fields
}
