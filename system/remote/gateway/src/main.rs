//! `condor-gateway`: serves a running system to other machines.

use std::path::PathBuf;
use std::process::ExitCode;
use std::time::Duration;

use clap::Parser;
use condor_gateway::config::{Config, access_control};
use condor_gateway::{Gateway, SystemChoice};
use condor_host::error::AnyError;
use condor_host::supervisor::EndSignals;
use condor_host::system::SystemWindows;
use condor_mbox::Messenger;
use condor_rt::linux::Environment;

/// Serves a running system to clients on other machines, over the network library zenoh
#[derive(Debug, Parser)]
#[command(name = "condor-gateway", version)]
struct Line {
    /// The file of the gateway's configuration; with `--access-control`, those of all robots behind the router
    #[arg(required = true)]
    configs: Vec<PathBuf>,
    /// The name of the system; needed only if several are running
    #[arg(long)]
    system: Option<String>,
    /// Prints the access rules for a zenoh router between clients and these gateways, and ends
    #[arg(long)]
    access_control: bool,
}

/// The time between two looks whether it shall end.
const LOOK: Duration = Duration::from_millis(50);

fn main() -> ExitCode {
    match run(&Line::parse()) {
        Ok(()) => ExitCode::SUCCESS,
        Err(error) => {
            eprintln!("condor-gateway: {error}");
            ExitCode::FAILURE
        }
    }
}

fn run(line: &Line) -> Result<(), AnyError> {
    let configs = line.configs.iter().map(|path| Config::read(path));
    let configs = configs.collect::<Result<Vec<_>, _>>()?;
    if line.access_control {
        println!("{:#}", access_control(&configs));
        return Ok(());
    }
    let [config] = &configs[..] else {
        return Err(
            "a gateway serves one configuration; several are only for --access-control".into(),
        );
    };
    let mut signals = EndSignals::new()?;
    let environment = Environment::read().ok();
    let which = SystemChoice::of(environment.as_ref(), line.system.clone());
    let gateway = Gateway::start(config, &which)?;
    match environment {
        // A service joins, so that its supervisor sees that it runs.
        Some(environment) => {
            let windows = SystemWindows::at(&environment.system, environment.window_bytes)?;
            let mut post = windows.claim(environment.processor)?.mailbox()?;
            post.join()?;
            while signals.taken() == 0 {
                post.serve(LOOK)?;
            }
            post.leave()?;
        }
        None => {
            while signals.taken() == 0 {
                std::thread::sleep(LOOK);
            }
        }
    }
    drop(gateway);
    Ok(())
}
