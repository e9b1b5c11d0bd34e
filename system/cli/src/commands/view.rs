//! `condor view`.

use std::net::{IpAddr, Ipv4Addr, SocketAddr};
use std::path::Path;
use std::sync::atomic::Ordering;

use clap::Args;

use super::SystemChoice;
use super::running::Running;
use crate::listening::{Rules, Token};
use crate::live::{self, Door, Stage, Workshop};
use condor_host::application::Application;
use condor_host::description::SystemDescription;
use condor_host::error::AnyError;
use condor_host::signals;

#[derive(Debug, Args)]
pub(crate) struct View {
    /// The variables, parameters and fields to show, or patterns with `*` and `?`; by default all
    names: Vec<String>,
    #[command(flatten)]
    at: At,
    #[command(flatten)]
    which: SystemChoice,
}

/// The address at which clients connect, and the origins that may.
#[derive(Debug, Args)]
pub(super) struct At {
    /// The port at which clients connect; 0 picks a free one
    #[arg(long, default_value_t = 8765)]
    port: u16,
    /// The address of this machine at which clients connect; everybody who can reach it may see what is shown, but
    /// changes need the token that is printed
    #[arg(long, value_name = "ADDRESS", default_value_t = IpAddr::V4(Ipv4Addr::LOCALHOST))]
    listen: IpAddr,
    /// Lets pages of this origin connect, such as `https://app.example`, or applications of the desktop,
    /// whose origin is `file://`; may be given several times
    #[arg(long = "origin", value_name = "ORIGIN")]
    origins: Vec<String>,
}

impl At {
    /// Makes the rules, with a new token.
    pub(super) fn door(&self) -> Result<Door, AnyError> {
        let mut secret = [0; 16];
        rustix::rand::getrandom(&mut secret, rustix::rand::GetRandomFlags::empty())?;
        Ok(Door {
            listen: SocketAddr::new(self.listen, self.port),
            rules: Rules {
                origins: self.origins.clone(),
                token: Token::of(secret),
            },
        })
    }
}

impl View {
    pub(crate) fn run(&self, application: &dyn Application) -> Result<(), AnyError> {
        let running = Running::find(&self.which)?;
        let file = Path::new(&running.status.file);
        let configuration = SystemDescription::read(file, application)?.robot;
        let robot = configuration.as_deref().map(|it| application.robot(it));
        let robot = robot.transpose()?.flatten();
        let workshop = || {
            let robot = robot.as_deref()?;
            Some(Workshop {
                application,
                robot,
                simulator: robot.simulator()?,
                file: configuration.as_deref()?,
                system: Some((&running.directory, file)),
            })
        };
        let mut view = running.view()?;
        view.join()?;
        let stage = Stage {
            directory: &running.directory,
            status: &running.status,
            patterns: &self.names,
            robot: robot.as_deref(),
            workshop: workshop(),
            door: self.at.door()?,
        };
        let end = signals::flag()?;
        let ends = || end.load(Ordering::Relaxed);
        live::serve(stage, &view, ends, || running.check())
    }
}
