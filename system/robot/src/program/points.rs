//! [`Points`]: the points of a stream from a text.

use condor_hand::trajectory::StreamPoint;
use condor_host::error::AnyError;

use crate::ALL;
use crate::motions::Batch;

/// The points of a stream, as a table of numbers with commas between them has them.
#[derive(Debug)]
pub(crate) struct Points {
    /// The joints that move, a bit for each.
    pub(crate) mask: u32,
    points: Vec<StreamPoint<ALL>>,
}

impl Points {
    /// Reads a table: its first line is `time` and the numbers of joints, from 0 in the order of the fingers;
    /// the others are times (s) and positions (rad). Velocities follow from the points beside each one; at
    /// the last one the joints rest.
    pub(crate) fn read(text: &str) -> Result<Self, AnyError> {
        let mut lines = (1..)
            .zip(text.lines())
            .filter(|(_, line)| !line.trim().is_empty());
        let (_, head) = lines.next().ok_or("the table has no points")?;
        let mut words = head.split(',').map(str::trim);
        if words.next() != Some("time") {
            return Err("line 1 of the table must begin with `time`".into());
        }
        let (mut mask, mut joints) = (0_u32, Vec::<usize>::new());
        for word in words {
            let joint = word.parse::<usize>().ok().filter(|joint| *joint < ALL);
            let joint = joint.filter(|&joint| mask >> joint & 1 == 0);
            let joint = joint.ok_or_else(|| {
                format!(
                    "line 1: `{word}` must be the number of a joint, 0 to {}",
                    ALL - 1
                )
            })?;
            mask |= 1 << joint;
            joints.push(joint);
        }
        let mut points = Vec::<StreamPoint<ALL>>::new();
        for (number, line) in lines {
            let numbers: Result<Vec<f64>, _> =
                line.split(',').map(|word| word.trim().parse()).collect();
            let numbers = numbers.map_err(|error| format!("line {number}: {error}"))?;
            let [time, positions @ ..] = numbers.as_slice() else {
                continue;
            };
            if positions.len() != joints.len() {
                let (found, expected) = (positions.len(), joints.len());
                return Err(format!("line {number} has {found} positions, not {expected}").into());
            }
            let mut point = StreamPoint {
                time: *time,
                positions: [0.0; ALL],
                velocities: [0.0; ALL],
            };
            for (joint, position) in joints.iter().zip(positions) {
                point.positions[*joint] = *position;
            }
            points.push(point);
        }
        if points.is_empty() {
            return Err("the table has no points".into());
        }
        for index in 1..points.len().saturating_sub(1) {
            let (before, after) = (points[index - 1], points[index + 1]);
            let time = after.time - before.time;
            for joint in &joints {
                let way = after.positions[*joint] - before.positions[*joint];
                points[index].velocities[*joint] = way / time;
            }
        }
        Ok(Self { mask, points })
    }

    /// Returns the points as batches that fit into requests.
    pub(crate) fn batches(&self) -> Vec<Batch<ALL>> {
        let parts: Vec<_> = self
            .points
            .chunks(Batch::<ALL>::room(self.mask).max(1))
            .collect();
        let count = parts.len();
        let batch = |(index, points): (usize, &[StreamPoint<ALL>])| Batch {
            sequence: index as u32,
            is_last: index + 1 == count,
            points: points.iter().copied().collect(),
        };
        parts.into_iter().enumerate().map(batch).collect()
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_table_becomes_batches() {
        let rows = (1..=20).map(|index| {
            let time = 0.1 * f64::from(index);
            format!("{time}, {}, 0.5\n", 0.2 * time)
        });
        let text = format!("time, 14,2\n{}", rows.collect::<String>());
        let points = Points::read(&text).unwrap();
        assert_eq!(points.mask, 1 << 14 | 1 << 2);
        let batches = points.batches();
        let of_each = Batch::<ALL>::room(points.mask);
        assert_eq!(batches.len(), 20_usize.div_ceil(of_each));
        let second = &batches[0].points[1];
        assert!((second.velocities[14] - 0.2).abs() < 1e-12, "{second:?}");
        let last = batches.last().unwrap();
        assert!(last.is_last && !batches[0].is_last);
        assert!(
            last.points
                .last()
                .unwrap()
                .velocities
                .iter()
                .all(|it| *it == 0.0)
        );
        for (text, why) in [
            ("", "the table has no points"),
            ("time,1\n", "the table has no points"),
            ("t,1", "line 1 of the table must begin with `time`"),
            (
                "time,16",
                "line 1: `16` must be the number of a joint, 0 to 15",
            ),
            ("time,1\n0.1,0.2,0.3", "line 2 has 2 positions, not 1"),
            ("time,1\n\n0.1,x", "line 3: invalid float literal"),
        ] {
            assert_eq!(Points::read(text).unwrap_err().to_string(), why);
        }
    }
}
