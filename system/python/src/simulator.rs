//! [`Simulator`]: a robot in Python, as a processor of a system, at the other side of the boards' registers.

use core::fmt;
use core::mem;
use std::sync::atomic::{AtomicBool, AtomicU32, Ordering::Relaxed};
use std::sync::{Mutex, MutexGuard, PoisonError};
use std::time::Duration;

use condor_dev::{Bus as _, Width};
use condor_mos::Rate;
use condor_rt::linux::{Environment, LinuxProcess, ProcessBus};
use condor_rt::{Machine as _, ProgramError, Setup};
use condor_vars::{Param, ValueKind, VarDescription, Watch};
use pyo3::exceptions::PyKeyboardInterrupt;
use pyo3::prelude::*;
use pyo3::types::PyByteArray;

use crate::failure::Failure;

/// The longest time that the background serves messages before it looks for texts to print and signals of Python.
const NAP: Duration = Duration::from_millis(20);

/// A parameter: `(name, unit, description, value, least value, greatest value)`.
type TuningRow = (String, String, String, f64, f64, f64);

/// A simulated robot behind the registers of the boards, whose steps are a function of Python.
#[pyclass(frozen)]
pub(crate) struct Simulator {
    /// The processor, until [`run`](Self::run) takes it.
    process: Mutex<Option<LinuxProcess>>,
    number: u8,
    bus: ProcessBus,
    name: String,
    rate: Rate,
    shown: ShownVariable,
    tuned: Vec<Param<f64>>,
    said: Mutex<Vec<String>>,
}

/// Variables whose names are known only at run time. Each value has two words.
struct ShownVariable {
    words: Vec<AtomicU32>,
    /// The name, the unit and the description of each variable.
    texts: Vec<[String; 3]>,
}

#[pymethods]
impl Simulator {
    /// Becomes the processor that the environment describes. From here on the simulated time waits for this process.
    #[new]
    fn new(
        py: Python<'_>,
        name: String,
        rate_hz: u32,
        variables: Vec<[String; 3]>,
        parameters: Vec<TuningRow>,
    ) -> PyResult<Self> {
        let rate = Rate::new(rate_hz, 1).ok_or_else(|| {
            Failure::refused(format!("`rate_hz` must be 1 or more, not {rate_hz}"))
        })?;
        let process = py.detach(|| {
            let environment = Environment::read()?;
            Ok::<_, Failure>(LinuxProcess::new(&environment, [])?)
        })?;
        Ok(Self {
            number: process.number().0,
            bus: process.bus(),
            process: Mutex::new(Some(process)),
            name,
            rate,
            shown: ShownVariable::new(variables),
            tuned: parameters.into_iter().map(parameter).collect(),
            said: Mutex::default(),
        })
    }

    /// Returns the number of the processor.
    fn number(&self) -> u8 {
        self.number
    }

    /// Reads `count` registers of `width` bytes each, one after the other from `address` on. Returns their bytes,
    /// little-endian.
    fn read<'py>(
        &self,
        py: Python<'py>,
        address: usize,
        width: usize,
        count: usize,
    ) -> PyResult<Bound<'py, PyByteArray>> {
        let of = width_of(width)?;
        let mut bytes = Vec::with_capacity(count.saturating_mul(width).min(1 << 20));
        for register in 0..count {
            let at = address.saturating_add(register.saturating_mul(width));
            let value = self.bus.read(at, of).map_err(Failure::from)?;
            bytes.extend(value.to_le_bytes().into_iter().take(width));
        }
        Ok(PyByteArray::new(py, &bytes))
    }

    /// Writes registers of `width` bytes each, one after the other from `address` on. `values` are their bytes,
    /// little-endian.
    fn write(&self, address: usize, width: usize, values: &[u8]) -> PyResult<()> {
        let of = width_of(width)?;
        for (register, value) in values.chunks_exact(width).enumerate() {
            let mut word = [0; 4];
            for (to, from) in word.iter_mut().zip(value) {
                *to = *from;
            }
            let at = address.saturating_add(register.saturating_mul(width));
            let written = self.bus.write(at, of, u32::from_le_bytes(word));
            written.map_err(Failure::from)?;
        }
        Ok(())
    }

    /// Sets the value of the variable number `index`, from 0, as rows show it.
    fn show(&self, index: usize, value: f64) {
        self.shown.set(index, value);
    }

    /// Returns the value of the parameter number `index`, from 0, in the present step; `None` if there is no such
    /// parameter.
    fn parameter(&self, index: usize) -> Option<f64> {
        self.tuned.get(index).map(Param::get)
    }

    /// Adds a text to those that the background prints on the terminal of the processor.
    fn say(&self, text: String) {
        lock(&self.said).push(text);
    }

    /// Calls `step` at the rate of the simulator with the time in seconds, until the program is asked to end or `step`
    /// raises an exception.
    fn run(&self, step: &Bound<'_, PyAny>) -> PyResult<()> {
        let (py, step) = (step.py(), step.clone().unbind());
        let process = lock(&self.process).take();
        let process = process
            .ok_or_else(|| Failure::refused("a simulator can run only once; make another one"))?;
        let raised = Mutex::new(None);
        let ran = py.detach(|| self.program(&process, &step, &raised));
        let raised = raised.into_inner().unwrap_or_else(PoisonError::into_inner);
        // The order to end may have been a SIGINT, which is an exception in Python, too.
        let ends = |error: &PyErr| {
            process.is_stopping() && error.is_instance_of::<PyKeyboardInterrupt>(py)
        };
        let failed = match raised {
            Some(error) if ends(&error) => None,
            Some(error) => Some(error),
            None => ran.err().map(|error| Failure::from(error).into()),
        };
        let Some(error) = failed else {
            return Ok(());
        };
        // In simulated time it keeps the turn until its supervisor has seen its end.
        mem::forget(process);
        Err(error)
    }
}

impl Simulator {
    fn program(
        &self,
        process: &LinuxProcess,
        step: &Py<PyAny>,
        raised: &Mutex<Option<PyErr>>,
    ) -> Result<(), ProgramError> {
        let is_over = AtomicBool::new(false);
        let end = |error: PyErr| {
            lock(raised).get_or_insert(error);
            is_over.store(true, Relaxed);
        };
        let mut body = |tick: &mut condor_rt::LoopTick<'_>| {
            if is_over.load(Relaxed) {
                return;
            }
            let now = Duration::from_nanos(tick.due.as_ns()).as_secs_f64();
            let done = Python::attach(|py| step.call1(py, (now,)).map(drop));
            if let Err(error) = done {
                end(error);
            }
        };
        let mut setup = Setup::new(process)?;
        setup.console()?;
        if !self.shown.texts.is_empty() {
            setup.watch(&self.shown);
        }
        for parameter in &self.tuned {
            setup.tune(parameter);
        }
        setup.fixed().servo(&self.name, self.rate, &mut body);
        setup.background(|background| {
            while !background.is_stopping() && !is_over.load(Relaxed) {
                background.serve(NAP)?;
                // Steps run while it prints, and may say more.
                let said = mem::take(&mut *lock(&self.said));
                for text in said {
                    background.print(format_args!("{text}\n"));
                }
                if let Some(error) = Python::attach(|py| py.check_signals().err()) {
                    end(error);
                }
            }
            match &*lock(raised) {
                Some(error) => Err(ProgramError::program(error)),
                None => Ok(()),
            }
        })
    }
}

impl ShownVariable {
    fn new(texts: Vec<[String; 3]>) -> Self {
        let words = texts
            .iter()
            .flat_map(|_| [AtomicU32::new(0), AtomicU32::new(0)]);
        Self {
            words: words.collect(),
            texts,
        }
    }

    fn set(&self, index: usize, value: f64) {
        let bits = value.to_bits();
        let words = self.words.get(2 * index..).unwrap_or_default();
        // Relaxed: only the loop that sets them samples them.
        for (word, half) in words.iter().zip([bits as u32, (bits >> 32) as u32]) {
            word.store(half, Relaxed);
        }
    }
}

impl Watch for ShownVariable {
    fn words(&self) -> &[AtomicU32] {
        &self.words
    }

    fn describe(&self, index: usize) -> Option<VarDescription<'_>> {
        let [_, unit, about] = self.texts.get(index)?;
        Some(VarDescription {
            kind: ValueKind::F64,
            unit,
            about,
            labels: &[],
            bounds: [[0; 2]; 2],
        })
    }

    fn name(&self, index: usize, to: &mut dyn fmt::Write) -> fmt::Result {
        self.texts
            .get(index)
            .map_or(Ok(()), |[name, ..]| to.write_str(name))
    }
}

/// Makes a parameter. Its texts stay for ever: a process is one simulator.
fn parameter((name, unit, about, value, least, most): TuningRow) -> Param<f64> {
    Param::new(name.leak(), unit.leak(), value, least..=most).about(about.leak())
}

fn width_of(bytes: usize) -> Result<Width, Failure> {
    match bytes {
        1 => Ok(Width::Bits8),
        2 => Ok(Width::Bits16),
        4 => Ok(Width::Bits32),
        _ => Err(Failure::refused(format!(
            "a register has 1, 2 or 4 bytes, not {bytes}"
        ))),
    }
}

fn lock<T>(mutex: &Mutex<T>) -> MutexGuard<'_, T> {
    mutex.lock().unwrap_or_else(PoisonError::into_inner)
}
