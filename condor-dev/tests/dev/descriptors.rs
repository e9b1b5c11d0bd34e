//! Descriptors, used and misused at random, beside a model that keeps a list of all that ever were.

use condor_dev::sim::{Model, SimBus};
use condor_dev::{
    Bus as _, Device, DeviceError, Driver, Fd, FdError, IoError, Location, NoInterrupts, OpenError,
    OpenMode, Presence, Registers, Switch, Width, device_switch,
};
use proptest::prelude::*;
use utah_mit_boards::Adc16;
use utah_mit_boards::sim::AdcModel;

/// A board that remembers a byte.
struct Latch(());

impl Driver for Latch {
    const NEW: Self = Self(());
    const READS: bool = true;
    const WRITES: bool = true;

    fn probe<B: condor_dev::Bus>(registers: Registers<'_, B>) -> bool {
        registers.answers(0, Width::Bits8)
    }

    fn init<B: condor_dev::Bus>(&self, registers: Registers<'_, B>) -> Result<(), B::Error> {
        registers.write8(0, 0)
    }

    fn open<B: condor_dev::Bus>(&self, registers: Registers<'_, B>) -> Result<(), B::Error> {
        registers.write8(1, 1)
    }

    fn close<B: condor_dev::Bus>(&self, registers: Registers<'_, B>) -> Result<(), B::Error> {
        registers.write8(1, 0)
    }

    fn read<B: condor_dev::Bus>(
        &self,
        registers: Registers<'_, B>,
        into: &mut [u8],
    ) -> Result<usize, DeviceError<B::Error>> {
        let Some(first) = into.first_mut() else {
            return Ok(0);
        };
        *first = registers.read8(0)?;
        Ok(1)
    }

    fn write<B: condor_dev::Bus>(
        &self,
        registers: Registers<'_, B>,
        from: &[u8],
    ) -> Result<usize, DeviceError<B::Error>> {
        let Some(first) = from.first() else {
            return Ok(0);
        };
        registers.write8(0, *first)?;
        Ok(1)
    }

    fn read_ready<B: condor_dev::Bus>(&self, _: Registers<'_, B>) -> Result<bool, B::Error> {
        Ok(true)
    }

    fn write_ready<B: condor_dev::Bus>(&self, _: Registers<'_, B>) -> Result<bool, B::Error> {
        Ok(true)
    }
}

/// Its registers: the byte, and whether the board is open.
#[derive(Default)]
struct LatchModel([u8; 2]);

impl Model for LatchModel {
    fn size(&self) -> usize {
        2
    }

    fn read(&mut self, offset: usize, _: Width) -> Option<u32> {
        self.0.get(offset).copied().map(u32::from)
    }

    fn write(&mut self, offset: usize, _: Width, value: u32) -> Option<()> {
        *self.0.get_mut(offset)? = value.to_le_bytes()[0];
        Some(())
    }
}

device_switch! {
    struct Boards {
        adc: Adc16 = [Location::at(0x1000)],
        latch: Latch = [Location::at(0x2000), Location::at(0x3000), Location::at(0x4000)],
    }
}

const FDS: usize = 4;
/// The latch that is not there.
const ABSENT: u8 = 1;

type TestSwitch = Switch<SimBus, NoInterrupts, Boards, FDS>;

#[derive(Clone, Debug)]
enum Step {
    Open { latch: bool, board: u8, mode: u8 },
    Close(prop::sample::Index),
    Read(prop::sample::Index),
    Write(prop::sample::Index, u8),
    HoldAdc(prop::sample::Index),
    HoldLatch(prop::sample::Index),
    Drop,
}

fn steps() -> impl Strategy<Value = Vec<Step>> {
    let which = any::<prop::sample::Index>;
    let open = (any::<bool>(), 0..4_u8, 0..8_u8);
    let step = prop_oneof![
        4 => open.prop_map(|(latch, board, mode)| Step::Open { latch, board, mode }),
        3 => which().prop_map(Step::Close),
        3 => which().prop_map(Step::Read),
        3 => (which(), any::<u8>()).prop_map(|(which, byte)| Step::Write(which, byte)),
        1 => which().prop_map(Step::HoldAdc),
        1 => which().prop_map(Step::HoldLatch),
        1 => Just(Step::Drop),
    ];
    prop::collection::vec(step, 0..if cfg!(miri) { 12 } else { 60 })
}

/// One descriptor that was given out.
#[derive(Clone, Copy, Debug)]
struct Given {
    fd: Fd,
    latch: bool,
    board: u8,
    mode: OpenMode,
    open: bool,
}

/// All descriptors that ever were, and the bytes of the latches.
#[derive(Default)]
struct Naive {
    given: Vec<Given>,
    bytes: [u8; 3],
}

impl Naive {
    fn open(&self, latch: bool, board: u8, mode: OpenMode) -> Result<(), OpenError<'static>> {
        let (name, boards) = if latch { ("latch", 3) } else { ("adc", 1) };
        if board >= boards {
            return Err(OpenError::NoSuchBoard {
                name,
                board,
                boards,
            });
        }
        if latch && board == ABSENT {
            let presence = Presence::Absent;
            return Err(OpenError::NotPresent {
                name,
                board,
                presence,
            });
        }
        let neither = !mode.intersects(OpenMode::READ | OpenMode::WRITE);
        if neither || (!latch && mode.contains(OpenMode::WRITE)) {
            return Err(OpenError::Direction { name, mode });
        }
        let same = |given: &&Given| given.open && (given.latch, given.board) == (latch, board);
        let mut others = self.given.iter().filter(same);
        let alone = |given: &Given| given.mode.contains(OpenMode::EXCLUSIVE);
        if mode.contains(OpenMode::EXCLUSIVE) && others.clone().next().is_some()
            || others.any(alone)
        {
            return Err(OpenError::Busy { name, board });
        }
        if self.given.iter().filter(|given| given.open).count() == FDS {
            return Err(OpenError::TooMany { count: FDS });
        }
        Ok(())
    }

    /// The number that the next descriptor gets.
    fn free(&self) -> u16 {
        let taken = |number| {
            let mut open = self.given.iter().filter(|given| given.open);
            open.any(|given| given.fd.number() == number)
        };
        (0..FDS as u16).find(|number| !taken(*number)).unwrap()
    }

    fn check(&self, index: usize, wanted: OpenMode) -> Result<Given, FdError> {
        let given = self.given[index];
        let fd = given.fd;
        let mut later = self.given[index + 1..].iter();
        if !given.open || later.any(|later| later.fd.number() == fd.number()) {
            return Err(FdError::Closed { fd });
        }
        if !given.mode.contains(wanted) {
            let opened = given.mode;
            return Err(FdError::Direction { fd, wanted, opened });
        }
        Ok(given)
    }

    fn hold(&self, index: usize, latch: bool) -> Result<(), FdError> {
        let given = self.check(index, OpenMode::empty())?;
        let wanted = if latch { "latch" } else { "adc" };
        if given.latch == latch {
            Ok(())
        } else {
            Err(FdError::WrongType {
                fd: given.fd,
                wanted,
            })
        }
    }

    /// Whether a latch is open.
    fn is_open(&self, board: u8) -> bool {
        let mut given = self.given.iter();
        given.any(|given| given.open && given.latch && given.board == board)
    }
}

/// What somebody holds.
enum Held<'s> {
    Adc(Device<'s, SimBus, Adc16, FDS>),
    Latch(Device<'s, SimBus, Latch, FDS>),
}

impl Held<'_> {
    fn fd(&self) -> Fd {
        match self {
            Self::Adc(device) => device.fd(),
            Self::Latch(device) => device.fd(),
        }
    }
}

fn started() -> (SimBus, TestSwitch) {
    let bus = SimBus::new();
    let mut adc = AdcModel::default();
    adc.channels = [0x5151; 16];
    bus.insert(0x1000, adc);
    bus.insert(0x2000, LatchModel::default());
    bus.insert(0x4000, LatchModel::default());
    let switch = Switch::new(bus.clone(), NoInterrupts, Boards::new());
    switch.start();
    (bus, switch)
}

proptest! {
    #[test]
    fn the_switch_does_what_a_list_of_all_descriptors_does(steps in steps()) {
        let (bus, switch) = started();
        let mut model = Naive::default();
        let mut held = Vec::<Held<'_>>::new();
        for step in steps {
            let some = |which: &prop::sample::Index| {
                (!model.given.is_empty()).then(|| which.index(model.given.len()))
            };
            match &step {
                Step::Open { latch, board, mode } => {
                    let (latch, board) = (*latch, *board);
                    let mode = OpenMode::from_bits_truncate(*mode);
                    let name = if latch { "latch" } else { "adc" };
                    let opened = switch.open(name, board, mode);
                    prop_assert_eq!(opened.map(|_| ()), model.open(latch, board, mode));
                    if let Ok(fd) = opened {
                        prop_assert_eq!(fd.number(), model.free());
                        let unlike = |given: &Given| given.fd != fd;
                        prop_assert!(model.given.iter().all(unlike));
                        model.given.push(Given { fd, latch, board, mode, open: true });
                    }
                }
                Step::Close(which) => {
                    let Some(index) = some(which) else { continue };
                    let fd = model.given[index].fd;
                    let mut expected = model.check(index, OpenMode::empty()).map(|_| ());
                    if expected.is_ok() && held.iter().any(|held| held.fd() == fd) {
                        expected = Err(FdError::InUse { fd });
                    }
                    prop_assert_eq!(switch.close(fd), expected.map_err(IoError::Fd));
                    if expected.is_ok() {
                        model.given[index].open = false;
                    }
                }
                Step::Read(which) => {
                    let Some(index) = some(which) else { continue };
                    let mut bytes = [0; 2];
                    let read = switch.read(model.given[index].fd, &mut bytes);
                    let expected = model.check(index, OpenMode::READ).map(|given| {
                        if given.latch { 1 } else { 2 }
                    });
                    prop_assert_eq!(read, expected.map_err(IoError::Fd));
                    if read.is_ok() {
                        let given = model.given[index];
                        let board = usize::from(given.board);
                        let byte = if given.latch { model.bytes[board] } else { 0x51 };
                        prop_assert_eq!(bytes[0], byte);
                    }
                }
                Step::Write(which, byte) => {
                    let Some(index) = some(which) else { continue };
                    let written = switch.write(model.given[index].fd, &[*byte]);
                    let expected = model.check(index, OpenMode::WRITE).map(|_| 1);
                    prop_assert_eq!(written, expected.map_err(IoError::Fd));
                    if written.is_ok() {
                        model.bytes[usize::from(model.given[index].board)] = *byte;
                    }
                }
                Step::HoldAdc(which) => {
                    let Some(index) = some(which) else { continue };
                    let device = switch.device(Boards::adc, model.given[index].fd);
                    prop_assert_eq!(device.as_ref().map(|_| ()).map_err(|e| *e), model.hold(index, false));
                    held.extend(device.ok().map(Held::Adc));
                }
                Step::HoldLatch(which) => {
                    let Some(index) = some(which) else { continue };
                    let device = switch.device(Boards::latch, model.given[index].fd);
                    prop_assert_eq!(device.as_ref().map(|_| ()).map_err(|e| *e), model.hold(index, true));
                    held.extend(device.ok().map(Held::Latch));
                }
                Step::Drop => drop(held.pop()),
            }
            for (board, base) in [(0, 0x2000), (2, 0x4000)] {
                let open = bus.read8(base + 1).unwrap() != 0;
                prop_assert_eq!(open, model.is_open(board));
            }
        }
    }
}
