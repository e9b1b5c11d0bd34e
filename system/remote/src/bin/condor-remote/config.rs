//! [`RemoteConfig`]: the file of robots.

use std::collections::BTreeMap;
use std::path::{Path, PathBuf};

use condor_remote::RemoteAccess;
use serde::Deserialize;

use crate::AnyError;

/// The robots of a user, and the name of the user's client.
#[derive(Debug, Default, Deserialize)]
#[serde(deny_unknown_fields, default)]
pub(crate) struct RemoteConfig {
    client: Option<String>,
    robots: BTreeMap<String, RemoteAccess>,
}

/// The robot that is meant.
pub(crate) struct Choice {
    /// Its name; `None` if it is the only one there.
    pub(crate) robot: Option<String>,
    pub(crate) access: RemoteAccess,
    pub(crate) client: String,
}

impl RemoteConfig {
    /// Reads a file, or that of this user if it is there.
    pub(crate) fn find(file: Option<&Path>) -> Result<Self, AnyError> {
        let usual = usual();
        let Some(path) = file.or_else(|| usual.as_deref().filter(|path| path.is_file())) else {
            return Ok(Self::default());
        };
        let shown = path.display();
        // The open of a FIFO would wait for its other end.
        if path.metadata().is_ok_and(|it| !it.is_file()) {
            return Err(format!("cannot read {shown}: it is not a regular file").into());
        }
        let text = std::fs::read_to_string(path)
            .map_err(|error| format!("cannot read {shown}: {error}"))?;
        Ok(toml::from_str(&text).map_err(|error| format!("{shown}: {error}"))?)
    }

    pub(crate) fn choose(
        &self,
        robot: Option<&str>,
        connect: &[String],
        client: Option<&str>,
    ) -> Result<Choice, AnyError> {
        let client = client.or(self.client.as_deref());
        let client = client.ok_or(
            "this client has no name: give one with --client, or as `client` in the file of robots",
        )?;
        let client = client.to_owned();
        let known = match robot {
            Some(name) => self.robots.get_key_value(name),
            None if self.robots.len() == 1 => self.robots.first_key_value(),
            None => None,
        };
        let mut access = known.map(|(_, access)| access.clone()).unwrap_or_default();
        if !connect.is_empty() {
            access.connect = connect.to_vec();
        }
        if access.connect.is_empty() && !access.scouting {
            let names: Vec<_> = self.robots.keys().map(String::as_str).collect();
            return Err(match (robot, names.is_empty()) {
                (_, true) => {
                    "the address of the robot is not known: give it with --connect, or in the file of robots"
                        .into()
                }
                (Some(robot), false) => format!(
                    "the file of robots has no robot `{robot}`; it has {}",
                    names.join(", ")
                ),
                (None, false) => format!("there are several robots; name one with --robot: {}", names.join(", ")),
            }
            .into());
        }
        let robot = robot.or(known.map(|(name, _)| name.as_str()));
        Ok(Choice {
            robot: robot.map(str::to_owned),
            access,
            client,
        })
    }
}

/// The file of this user.
fn usual() -> Option<PathBuf> {
    let own = std::env::var_os("XDG_CONFIG_HOME")
        .filter(|it| !it.is_empty())
        .map(PathBuf::from);
    let own = own.or_else(|| std::env::home_dir().map(|home| home.join(".config")));
    Some(own?.join("condor").join("remote.toml"))
}

#[cfg(test)]
mod tests {
    use super::*;

    fn known(text: &str) -> RemoteConfig {
        toml::from_str(text).expect("a file of robots")
    }

    #[test]
    fn the_only_robot_is_meant_and_the_line_goes_before_the_file() {
        let known =
            known("client = \"lab\"\n[robots.hand]\nconnect = [\"tcp/h:1\"]\npassword = \"p\"\n");
        let choice = known.choose(None, &[], None).expect("the only one");
        assert_eq!(
            (choice.robot.as_deref(), choice.client.as_str()),
            (Some("hand"), "lab")
        );
        assert_eq!(choice.access.password.as_deref(), Some("p"));
        let choice = known
            .choose(Some("arm"), &["tcp/a:1".into()], Some("desk"))
            .expect("by the line");
        assert_eq!(
            (choice.robot.as_deref(), choice.client.as_str()),
            (Some("arm"), "desk")
        );
        assert_eq!(choice.access, RemoteAccess::to("tcp/a:1"));
    }

    #[test]
    fn what_is_missing_is_named() {
        let complaint = |known: &RemoteConfig, robot| {
            known
                .choose(robot, &[], Some("lab"))
                .err()
                .map(|it| it.to_string())
        };
        let two = known(
            "[robots.arm]\nconnect = [\"tcp/a:1\"]\n[robots.hand]\nconnect = [\"tcp/h:1\"]\n",
        );
        assert_eq!(
            complaint(&two, None).as_deref(),
            Some("there are several robots; name one with --robot: arm, hand")
        );
        assert!(
            complaint(&two, Some("leg"))
                .is_some_and(|it| it.contains("no robot `leg`; it has arm, hand"))
        );
        assert!(
            complaint(&RemoteConfig::default(), None).is_some_and(|it| it.contains("--connect"))
        );
        assert!(
            two.choose(Some("arm"), &[], None)
                .is_err_and(|it| it.to_string().contains("--client"))
        );
    }
}
