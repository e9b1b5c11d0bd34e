//! The program of a hart, as a debugger has it.

use std::path::PathBuf;

use condor_debug::Tracer;
use condor_debug::gateway::{DebuggedProgram, Debuggee, ProgramEnd};
use condor_host::error::AnyError;
use condor_mbox::linux::{LinuxDoorbell, LinuxWindow};
use condor_mbox::{Doorbell as _, Processor};
use condor_rt::numbers::PROCESSORS;

use crate::{Control, HartState, MachineMemory, MemoryError, RAM};

/// The file of the debugger lock of processor `number`, beside the memory of its machine.
pub(crate) fn lock(memory: &MachineMemory, number: Processor) -> PathBuf {
    let name = format!("debugger-{}", number.0);
    memory.path().with_file_name(name)
}

/// Makes the tracer that sends commands to the stub of processor `number`.
pub(crate) fn tracer(
    memory: &MachineMemory,
    control: &Control<LinuxWindow>,
    number: Processor,
    doorbell: LinuxDoorbell<PROCESSORS>,
) -> Result<Tracer<LinuxWindow>, MemoryError> {
    let area = control.debug_area().map_err(memory.at())?;
    Ok(Tracer::new(area, move || doorbell.ring(number)))
}

/// The program of processor `number`, a hart of the machine with this memory.
pub(crate) fn of(
    memory: &MachineMemory,
    number: Processor,
    doorbell: LinuxDoorbell<PROCESSORS>,
) -> Result<Debuggee<LinuxWindow>, AnyError> {
    let map = memory.map();
    let hart = map.hart_of(number.0);
    let hart = hart.ok_or_else(|| format!("{number} is not a hart of this machine"))?;
    let control = memory.control(hart)?;
    let begin = RAM + u64::from(map.programs.at(hart));
    Ok(Debuggee {
        name: format!("hart {hart}, {number}"),
        tracer: tracer(memory, &control, number, doorbell)?,
        memory: memory.region().clone(),
        base: RAM,
        code: begin..begin + u64::from(map.program_bytes()),
        // Images begin at 0.
        bias: begin,
        lock: lock(memory, number),
        program: Box::new(move || match control.state() {
            Ok(HartState::Runs { start }) => DebuggedProgram::Runs(start),
            Ok(HartState::Ended { status, .. }) => {
                DebuggedProgram::Ended(ProgramEnd::Exited(status as u8))
            }
            _ => DebuggedProgram::Ended(ProgramEnd::Killed),
        }),
        host: None,
    })
}
