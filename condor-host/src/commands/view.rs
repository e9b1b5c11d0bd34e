//! `condor view`.

use std::net::{IpAddr, Ipv4Addr, SocketAddr};
use std::path::Path;
use std::sync::atomic::Ordering;

use clap::Args;

use super::Which;
use super::running::Running;
use crate::application::Application;
use crate::error::AnyError;
use crate::listening::{Rules, Token};
use crate::live::{self, Stage};
use crate::reading::robot_of;
use crate::signals;

#[derive(Debug, Args)]
pub(crate) struct View {
    /// The variables, parameters and fields to show, or patterns with `*` and `?`; by default all
    names: Vec<String>,
    /// The port at which clients connect; 0 takes a free one
    #[arg(long, default_value_t = 8765)]
    port: u16,
    /// The address of this machine at which clients connect; everybody who can reach it may look
    #[arg(long, value_name = "ADDRESS", default_value_t = IpAddr::V4(Ipv4Addr::LOCALHOST))]
    listen: IpAddr,
    /// Lets pages of this origin connect, such as `https://app.example`, or applications of the desktop,
    /// whose origin is `file://`; may be given several times
    #[arg(long = "origin", value_name = "ORIGIN")]
    origins: Vec<String>,
    #[command(flatten)]
    which: Which,
}

impl View {
    pub(crate) fn run(&self, application: &dyn Application) -> Result<(), AnyError> {
        let running = Running::find(&self.which)?;
        let robot = robot_of(Path::new(&running.status.file), application)?;
        let mut view = running.view()?;
        view.join()?;
        let mut secret = [0; 16];
        rustix::rand::getrandom(&mut secret, rustix::rand::GetRandomFlags::empty())?;
        let stage = Stage {
            directory: &running.directory,
            status: &running.status,
            patterns: &self.names,
            robot: robot.as_deref(),
            listen: SocketAddr::new(self.listen, self.port),
            rules: Rules {
                origins: self.origins.clone(),
                token: Token::of(secret),
            },
        };
        let end = signals::flag()?;
        let ends = || end.load(Ordering::Relaxed);
        live::serve(stage, &view, ends, || running.check())
    }
}
