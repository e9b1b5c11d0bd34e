//! A ball in the fingers of the simulated hand, held with a stiffness that is programmed: somebody
//! pushes and twists it along each axis, and it gives way as much as it should.
//!
//! ```sh
//! cargo run --release -p condor-hand --example grasp
//! ```
//!
//! Three fingers hold it, and then four. Exits with 1 if a stiffness is more than 1 % from the
//! programmed one, or if a finger slips.

use std::error::Error;
use std::process::ExitCode;

use condor_hand::config::Hand;
use condor_hand::controller::FingerController;
use condor_hand::dynamics::Dynamics;
use condor_hand::grasp::{
    ContactFriction, FingerState, GraspStiffness, GraspTuning, Posture, SpatialGain, Squeeze,
    TorqueLimits, TuningSurface, Wrench,
};
use condor_hand::kinematics::{JointLimits, PlanarFinger};
use condor_hand::math;
use condor_hand::plant::{self, ObjectParameters, PlantModel, SimObject, SimStop};
use condor_hand::servo::JointTarget;
use condor_hand::transmission::Linear;
use nalgebra::{Vector3, Vector4};

const HAND: &str = include_str!("../hands/utah-mit.toml");

/// N/m along x, y and z, N m/rad about them.
const STIFFNESS: [f64; 6] = [200.0, 250.0, 150.0, 0.1, 0.1, 0.1];
const DAMPING: [f64; 6] = [4.0, 4.0, 4.0, 2e-3, 2e-3, 2e-3];

/// The force and the moment on the ball, N and N m.
const PUSH_N: f64 = 0.2;
const TWIST_NM: f64 = 4e-3;
const SETTLING_S: f64 = 6.0;

const MASS_KG: f64 = 0.05;
const RADIUS_M: f64 = 0.02;
const CENTER_M: [f64; 3] = [0.085, 0.004, -0.0625];
/// From the centre of the ball to the tip of each finger, the thumb last.
const TIPS: [[f64; 3]; 4] = [
    [0.0, 0.9, 0.4],
    [0.1, 0.0, 1.0],
    [0.0, -0.9, 0.4],
    [0.05, 0.0, -1.0],
];
const SQUEEZE_N: f64 = 1.5;
const CLOSING_S: f64 = 1.0;

const TOLERANCE: f64 = 0.01;

fn main() -> ExitCode {
    match demonstrate() {
        Ok(status) => status,
        Err(error) => {
            eprintln!("{error}");
            ExitCode::FAILURE
        }
    }
}

fn demonstrate() -> Result<ExitCode, Box<dyn Error>> {
    let mut good = true;
    good &= hold([0, 2, 3])?;
    good &= hold([0, 1, 2, 3])?;
    Ok(if good {
        ExitCode::SUCCESS
    } else {
        ExitCode::FAILURE
    })
}

/// Holds the ball in these fingers, and says whether it is as stiff as it should be.
fn hold<const M: usize>(numbers: [usize; M]) -> Result<bool, Box<dyn Error>> {
    let mut bench = Bench::new(numbers)?;
    bench.take()?;
    bench.run(2.0)?;
    let start = bench.ball();

    println!("{M} fingers hold a ball of {MASS_KG} kg with edges of {SQUEEZE_N} N");
    println!("programmed and apparent stiffness along x, y and z, N/m, and about them, N m/rad:");
    let mut good = true;
    for (axis, programmed) in STIFFNESS.into_iter().enumerate() {
        bench.push[axis] = if axis < 3 { PUSH_N } else { TWIST_NM };
        bench.run(SETTLING_S)?;
        let apparent = bench.push[axis] / moved(&start, &bench.ball())[axis];
        bench.push = [0.0; 6];
        bench.run(SETTLING_S)?;
        println!("  {programmed:8.2} {apparent:9.4}");
        good &= math::abs(apparent / programmed - 1.0) <= TOLERANCE;
    }
    println!(
        "the least friction margin was {:.2} N, slid: {}\n",
        bench.margin, bench.slid
    );
    Ok(good && !bench.slid)
}

/// A simulated hand, its controllers, and the law that makes the ball stiff.
struct Bench<const M: usize> {
    hand: Hand<4, 4, 8>,
    plant: plant::SimHand<PlanarFinger, Linear<4, 8>, M, 4, 8>,
    fingers: [FingerController<PlanarFinger, Linear<4, 8>, 4, 8>; M],
    velocities: [Vector4<f64>; M],
    law: Option<GraspStiffness<M, 4>>,
    /// The force and the moment that push the ball, N and N m.
    push: [f64; 6],
    /// The share of the ball's weight that a hand outside of the simulation still holds, 1 to 0.
    support: f64,
    margin: f64,
    slid: bool,
}

impl<const M: usize> Bench<M> {
    /// The fingers stand a millimetre from the ball.
    fn new(numbers: [usize; M]) -> Result<Self, Box<dyn Error>> {
        let hand = Hand::<4, 4, 8>::from_toml(HAND, "utah-mit.toml")?;
        let machine = PlantModel {
            joint_stop: SimStop {
                stiffness: 50.0,
                damping: 0.1,
            },
            updates: 25,
            surface: plant::SimSurface {
                stiffness: 5e4,
                damping: 20.0,
                shear_stiffness: 5e4,
                shear_damping: 20.0,
                friction: 0.8,
            },
            ..PlantModel::default()
        };
        let center = Vector3::from(CENTER_M);
        let mut plants = Vec::new();
        let mut controllers = Vec::new();
        for number in numbers {
            let finger = &hand.fingers[number];
            let mechanism = finger.planar().ok_or("a finger is not planar")?;
            let limits = finger.limits();
            let limits = JointLimits::new(limits.low, limits.high)?;
            let direction = Vector3::from(TIPS[number]).normalize();
            let target = center + direction * (RADIUS_M + 1e-3);
            // Well bent, the joints are far from their stops.
            let present = Vector4::new(0.0, 0.9, 0.8, 0.5);
            let q = finger.chain().nearest(&target, &present, &limits)?.posture;
            let tendons = finger.transmission()?;
            plants.push(machine.finger(finger, mechanism, tendons, q)?);
            controllers.push(FingerController::new(&hand, finger, mechanism, tendons)?);
        }
        let plants = plants.try_into().map_err(|_| "as many plants as numbers")?;
        let fingers = controllers
            .try_into()
            .map_err(|_| "as many controllers as numbers")?;
        let ball = SimObject::new(ObjectParameters::ball(MASS_KG, RADIUS_M), center)?;
        let mut parameters = machine.hand_parameters(&hand);
        parameters.tip_object = machine.surface;
        Ok(Self {
            plant: plant::SimHand::new(plants, parameters)?.with_object(ball),
            hand,
            fingers,
            velocities: [Vector4::zeros(); M],
            law: None,
            push: [0.0; 6],
            support: 1.0,
            margin: f64::INFINITY,
            slid: false,
        })
    }

    /// Closes the fingers on the ball, and lets go of it.
    fn take(&mut self) -> Result<(), Box<dyn Error>> {
        let tuning = self.tuning(0.0)?;
        let mut law = GraspStiffness::engage(&self.states(), tuning)?;
        let center = Vector3::from(CENTER_M);
        law.set_desired(
            &self
                .states()
                .map(|state| center + (state.tip - center).normalize() * RADIUS_M),
        )?;
        self.law = Some(law);
        self.run(CLOSING_S)?;
        let steps = 100_u32;
        for step in 1..=steps {
            let share = f64::from(step) / f64::from(steps);
            let tuning = self.tuning(share)?;
            if let Some(law) = &mut self.law {
                law.set_tuning(tuning)?;
            }
            self.run(CLOSING_S / f64::from(steps))?;
        }
        for step in 1..=steps {
            self.support = 1.0 - f64::from(step) / f64::from(steps);
            self.run(CLOSING_S / f64::from(steps))?;
        }
        // From here on the ball is to be where it is now.
        self.law = Some(GraspStiffness::engage(&self.states(), self.tuning(1.0)?)?);
        self.margin = f64::INFINITY;
        self.slid = false;
        Ok(())
    }

    fn tuning(&self, squeeze: f64) -> Result<GraspTuning<M, 4>, Box<dyn Error>> {
        let center = self.ball().position;
        Ok(GraspTuning {
            stiffness: SpatialGain::diagonal(STIFFNESS)?,
            damping: SpatialGain::diagonal(DAMPING)?,
            center,
            feed_forward: Wrench::zero(),
            squeeze: Squeeze::equal(squeeze * SQUEEZE_N)?,
            surface: TuningSurface::Ball(center),
            friction: ContactFriction::point(0.8)?,
            posture: Posture {
                stiffness: 0.1,
                damping: 2e-3,
            },
            limits: [TorqueLimits::none(); M],
        })
    }

    /// Passes so much time.
    fn run(&mut self, seconds: f64) -> Result<(), Box<dyn Error>> {
        let end = self.plant.time_s() + seconds;
        while self.plant.time_s() < end {
            self.tick()?;
        }
        Ok(())
    }

    fn tick(&mut self) -> Result<(), Box<dyn Error>> {
        let states = self.states();
        let feed_forward = -Vector3::from(self.hand.gravity) * MASS_KG * (1.0 - self.support);
        let law = self.law.as_mut().ok_or("nothing is held")?;
        let mut tuning = *law.tuning();
        tuning.feed_forward.force = feed_forward;
        law.set_tuning(tuning)?;
        let output = law.update(&states)?;
        for (finger, torques) in self.fingers.iter_mut().zip(&output.torques) {
            for (joint, &torque) in torques.iter().enumerate() {
                finger.set_target(joint, JointTarget::Grasp(torque))?;
            }
        }
        self.margin = output.margins.into_iter().fold(self.margin, math::min);

        let gravity = Vector3::from(self.hand.gravity);
        let period_s = 1.0 / f64::from(self.hand.servo_hz);
        let mut commands = [[0.0; 8]; M];
        for (((finger, plant), command), velocity) in self
            .fingers
            .iter_mut()
            .zip(self.plant.fingers())
            .zip(&mut commands)
            .zip(&mut self.velocities)
        {
            let tick = finger.tick(&plant.readings(), &gravity, period_s);
            if let Some(fault) = tick.fault {
                return Err(format!("{}: {}", fault.code, fault.code.remedy()).into());
            }
            *velocity = tick.output.velocity;
            *command = tick.output.command;
        }
        self.plant.push_object(self.pushes())?;
        self.plant.step(&commands)?;
        self.slid |= self
            .plant
            .object_contacts()
            .iter()
            .any(|contact| contact.is_sliding);
        Ok(())
    }

    /// Returns the force and the moment that act on the ball beside the fingers.
    fn pushes(&self) -> Wrench {
        let [fx, fy, fz, mx, my, mz] = self.push;
        let mut wrench = Wrench {
            force: Vector3::new(fx, fy, fz),
            moment: Vector3::new(mx, my, mz),
        };
        if let (Some(ball), true) = (self.plant.object(), self.support > 0.0) {
            let from = ball.pose().position - Vector3::from(CENTER_M);
            let held =
                -from * 500.0 - ball.velocity() * 10.0 - Vector3::from(self.hand.gravity) * MASS_KG;
            wrench.force += held * self.support;
            wrench.moment -= ball.angular_velocity() * 1e-3 * self.support;
        }
        wrench
    }

    fn states(&self) -> [FingerState<4>; M] {
        let gravity = Vector3::from(self.hand.gravity);
        core::array::from_fn(|index| {
            let finger = &self.plant.fingers()[index];
            let q = finger.q();
            let weight = self.fingers[index].mechanism().gravity_torque(q, &gravity);
            FingerState::new(
                self.fingers[index].mechanism(),
                q,
                &self.velocities[index],
                &weight,
            )
        })
    }

    fn ball(&self) -> condor_hand::Pose {
        self.plant
            .object()
            .map_or_else(condor_hand::Pose::identity, SimObject::pose)
    }
}

/// Returns the displacement and the small rotation of a ball, m and rad.
fn moved(from: &condor_hand::Pose, to: &condor_hand::Pose) -> [f64; 6] {
    let moved = to.position - from.position;
    let turn = to.rotation * from.rotation.transpose();
    let turned = Vector3::new(
        turn[(2, 1)] - turn[(1, 2)],
        turn[(0, 2)] - turn[(2, 0)],
        turn[(1, 0)] - turn[(0, 1)],
    ) / 2.0;
    [moved.x, moved.y, moved.z, turned.x, turned.y, turned.z]
}
