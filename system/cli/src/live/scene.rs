//! [`Scene`]: the robot as the page draws it.

use std::time::{Duration, Instant};

use serde_json::{Value as Json, json};

use condor_host::robot::Robot;
use condor_host::watching::{CatalogEntry, RowSource, SourceRow, VariableCatalog, float};

/// The least time between two pictures.
const PICTURE: Duration = Duration::from_millis(33);
/// The digits of a metre that are told.
const DIGITS: f64 = 1e5;

/// The lines and objects of a robot, from the rows of its variables.
pub(super) struct Scene<'r> {
    robot: &'r dyn Robot,
    /// The last values of [`variables`].
    values: Vec<f64>,
    /// The places of values among the fields of each source of rows, and among `values`.
    places: Vec<Vec<(usize, usize)>>,
    drawn: Option<Instant>,
}

/// Returns the variables that move and colour a robot: of its joints, of its actuators, and of what it handles.
pub(super) fn variables(robot: &dyn Robot) -> Vec<String> {
    let joints = robot.joints().iter().map(|joint| joint.position.clone());
    let lines = robot.lines(&[]).into_iter();
    let efforts = lines.filter_map(|line| line.effort);
    let observed = robot.observed().iter().cloned();
    joints.chain(efforts).chain(observed).collect()
}

impl<'r> Scene<'r> {
    /// Finds the variables among `columns`.
    pub(super) fn of(
        robot: &'r dyn Robot,
        known: &VariableCatalog,
        columns: &[&CatalogEntry],
        sources: &[RowSource],
    ) -> Self {
        let variables = variables(robot);
        let mut places: Vec<_> = sources.iter().map(|_| Vec::new()).collect();
        for (number, name) in variables.iter().enumerate() {
            let Some(column) = known.column(name, columns) else {
                continue;
            };
            for (source, places) in sources.iter().zip(&mut places) {
                places.extend(source.field_of(column).map(|field| (field, number)));
            }
        }
        Self {
            robot,
            values: vec![f64::NAN; variables.len()],
            places,
            drawn: None,
        }
    }

    /// Takes a row. Returns a picture, as a text of JSON, if one is wanted and it is time for it.
    pub(super) fn row(
        &mut self,
        source: usize,
        row: &SourceRow<'_>,
        is_wanted: bool,
        now: Instant,
    ) -> Option<String> {
        let places = self.places.get(source).filter(|all| !all.is_empty())?;
        let values: Vec<_> = row.values().map(|(_, value)| float(value)).collect();
        for (field, number) in places {
            if let (Some(from), Some(to)) = (values.get(*field), self.values.get_mut(*number)) {
                *to = *from;
            }
        }
        if !is_wanted || self.drawn.is_some_and(|drawn| now - drawn < PICTURE) {
            return None;
        }
        self.drawn = Some(now);
        Some(picture(self.robot, &self.values).to_string())
    }
}

/// Returns a picture of a robot. `values` are those of its [`variables`], NaN if they are not known.
pub(super) fn picture(robot: &dyn Robot, values: &[f64]) -> Json {
    let joints = robot.joints().len();
    let (positions, rest) = values.split_at(joints.min(values.len()));
    let mut rest = rest.iter().copied();
    let lines = robot.lines(positions).into_iter().map(|line| {
        let effort = line.effort.as_ref().and_then(|_| rest.next());
        let points: Vec<_> = line.points.iter().copied().map(near).collect();
        json!({
            "name": line.name,
            "points": points,
            "radius": line.radius_m,
            "isTendon": line.effort.is_some(),
            "effort": effort,
        })
    });
    let lines: Vec<_> = lines.collect();
    let observed: Vec<_> = rest.collect();
    let objects = robot.objects(positions, &observed).into_iter();
    let objects = objects.map(|object| {
        let contacts = object.contacts.into_iter();
        let contacts = contacts.map(|it| {
            json!({ "name": it.name, "at": near(it.point), "normal": near(it.normal), "force": it.force_n })
        });
        json!({
            "name": object.name,
            "center": near(object.center),
            "radius": object.radius_m,
            "contacts": contacts.collect::<Vec<_>>(),
        })
    });
    json!({ "lines": lines, "objects": objects.collect::<Vec<_>>() })
}

/// Rounds a point to the precision with which it is drawn.
fn near(point: [f64; 3]) -> [f64; 3] {
    point.map(|it| (it * DIGITS).round() / DIGITS)
}
