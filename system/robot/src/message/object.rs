use condor_hand::controller::FingerController;
use condor_hand::dynamics::Dynamics;
use condor_hand::transmission::Transmission;
use condor_mbox::{AccessError, Exclusion, MemoryWindow, Region, StaticMemory};

use super::handler::{HandIdentity, ServoHandler};
use super::layout::ServoLayout;
use super::memory::FingerMemory;
use super::servo_loop::HandLoop;

/// The fingers that one processor serves, as an object that answers messages. The hand has `F` fingers of `N` joints.
///
/// The object is private memory of the servo processor. Through it its two parts, the [`ServoHandler`] in the
/// background and the [`HandLoop`] in the servo loop, pass states to each other without locks.
///
/// ```
/// # use std::time::Duration;
/// # use condor_mbox::sim::SimSystem;
/// # use condor_mbox::{Call, CriticalSection, MemoryWindow, Messenger, Allocator, Processor, Region};
/// use condor_hand::config::Hand;
/// use condor_hand::controller::FingerController;
/// use condor_hand::servo::{ServoMode, FingerReadings};
/// use condor_robot::message::{HandIdentity, SERVO, ServoClient, ServoObject, ServoLayout};
///
/// # const MASTER: Processor = Processor(0);
/// # const REMOTE: Processor = Processor(1);
/// # let system = SimSystem::<2>::in_real_time(4096);
/// # let [_, windows] = system.windows(REMOTE);
/// # let text = include_str!("../../../../condor-hand/hands/utah-mit.toml");
/// let hand = Hand::<4, 4, 8>::from_toml(text, "utah-mit.toml")?;
/// let finger = &hand.fingers[0];
///
/// // The processor of one finger.
/// let ram = Region::users(windows.data)?;
/// let places = ServoLayout::<4, 4>::new(&mut Allocator::new(ram.size()), 2)?;
/// let names = ["index", "middle", "ring", "thumb"];
/// let identity = HandIdentity::new(&hand.name, names, hand.servo_hz);
/// let controller = FingerController::new(&hand, finger, finger.chain(), finger.transmission()?)?;
/// let mut object = ServoObject::new();
/// let (handler, mut servos) =
///     object.split(identity, &ram, places, CriticalSection, [Some(controller), None, None, None])?;
/// let handler = |call: &Call<'_>| handler.answer(call);
/// let mut remote = system.mailbox(REMOTE)?;
/// remote.set_vector(SERVO, &handler, "servos")?;
/// remote.join()?;
///
/// // The master; `Mailbox` is its own.
/// let mut master = system.mailbox(MASTER)?;
/// master.join()?;
/// let master = &master;
/// # let done = std::sync::atomic::AtomicBool::new(false);
/// # let done = &done;
/// std::thread::scope(|threads| {
///     // In each tick of the servo loop:
///     # let sensed = FingerReadings { position: [0.1, 0.6, 0.8, 0.7].into(), actuator_position: [0.0; 8], effort: [4.0; 8], touch: 0.0 };
///     # threads.spawn(move || while !done.load(std::sync::atomic::Ordering::Relaxed) {
///     servos.tick(0, &sensed, &hand.gravity.into(), 1.0 / 400.0);
///     # });
///     # threads.spawn(move || while !done.load(std::sync::atomic::Ordering::Relaxed) {
///     #     remote.serve(Duration::from_millis(10)).unwrap();
///     # });
///     # let told = (|| {
///     let ram = Region::users(&master.windows(REMOTE)?.data)?;
///     let mut client = ServoClient::new(master, REMOTE, &ram, places)?;
///     client.enable(0, Some(2), ServoMode::Torque, Duration::from_secs(60))?;
///     assert_eq!(client.status(0, Duration::from_secs(60))?.modes[2], ServoMode::Torque);
///     # Ok::<(), Box<dyn std::error::Error>>(())
///     # })();
///     # done.store(true, std::sync::atomic::Ordering::Relaxed);
///     # told
/// })?;
/// # Ok::<(), Box<dyn std::error::Error>>(())
/// ```
#[derive(Debug)]
pub struct ServoObject<const F: usize, const N: usize> {
    desk: StaticMemory<16>,
    fingers: [FingerMemory<N>; F],
}

/// The two parts of a [`ServoObject`]: the [`ServoHandler`] for the background, and the
/// [`HandLoop`] for the servo loop.
pub type ServoEnds<'o, M, T, W, X, const F: usize, const N: usize, const A: usize> =
    (ServoHandler<'o, W, X, F, N>, HandLoop<'o, M, T, W, F, N, A>);

impl<const F: usize, const N: usize> ServoObject<F, N> {
    /// Makes the memory of the object; [`split`](Self::split) then connects it to controllers.
    #[must_use]
    pub const fn new() -> Self {
        const { assert!(F > 0 && F <= 32, "a hand has 1 to 32 fingers") };
        const { assert!(N > 0 && N <= 32, "a finger has 1 to 32 joints") };
        Self {
            desk: StaticMemory::new(),
            fingers: [const { FingerMemory::new() }; F],
        }
    }

    /// Returns the two parts of the object: the handler for the background and the part for the
    /// servo loop.
    ///
    /// * `identity`: the names with which the servos answer clients.
    /// * `region`: the users' region of this processor's own `data`, in which `places` are.
    /// * `exclusion`: keeps the handler's calls apart, if the mailbox can call it from several
    ///   contexts.
    /// * `controllers`: one for each finger of the hand, or `None` if this processor does not serve
    ///   the finger.
    ///
    /// Earlier requests, and set-points that are still in the region, are discarded.
    ///
    /// # Errors
    /// [`AccessError`] of the kind `OutOfBounds` if the places are not in the region, or of another
    /// kind if the memory cannot be accessed.
    pub fn split<M, T, W, X, const A: usize>(
        &mut self,
        identity: HandIdentity<F>,
        region: &Region<W>,
        places: ServoLayout<F, N>,
        exclusion: X,
        controllers: [Option<FingerController<M, T, N, A>>; F],
    ) -> Result<ServoEnds<'_, M, T, W, X, F, N, A>, AccessError>
    where
        M: Dynamics<N>,
        T: Transmission<N, A>,
        W: MemoryWindow + Clone,
        X: Exclusion,
    {
        places.check(region)?;
        for (memory, controller) in self.fingers.iter_mut().zip(&controllers) {
            memory.count = controller.as_ref().map_or(0, FingerController::joints);
        }
        let this = &*self;
        let served = (0..).zip(&controllers);
        let served = served.fold(0, |mask, (finger, controller)| {
            mask | u32::from(controller.is_some()) << finger
        });
        let servos = HandLoop::new(&this.fingers, region, places, controllers)?;
        let desk = Region::whole(this.desk.window());
        let handler = ServoHandler::new(
            desk,
            &this.fingers,
            identity,
            served,
            region.clone(),
            places,
            exclusion,
        );
        Ok((handler, servos))
    }
}

impl<const F: usize, const N: usize> Default for ServoObject<F, N> {
    fn default() -> Self {
        Self::new()
    }
}
