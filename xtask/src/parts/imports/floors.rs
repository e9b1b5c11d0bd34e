//! [`floors`]: an order of nodes in which all edges lead downwards.

use std::collections::BTreeSet;

/// Returns the nodes by floors, from bottom to top: each is as low as it can be above all that its edges
/// lead to. Nodes of circles are on none.
pub(super) fn floors<'n, N: Ord + Clone + 'n>(
    nodes: impl Iterator<Item = &'n N>,
    edges: &BTreeSet<(N, N)>,
) -> Vec<Vec<N>> {
    let mut left: BTreeSet<&N> = nodes.collect();
    let mut floors = Vec::new();
    loop {
        let above = |node: &&N| {
            let mut below = edges.iter().filter(|(from, _)| from == *node);
            below.all(|(_, to)| !left.contains(to))
        };
        let floor: Vec<&N> = left.iter().copied().filter(above).collect();
        if floor.is_empty() {
            return floors;
        }
        left.retain(|node| !floor.contains(node));
        floors.push(floor.into_iter().cloned().collect());
    }
}

#[cfg(test)]
mod tests {
    use super::floors;

    #[test]
    fn a_node_is_above_the_highest_of_those_below_it() {
        let edges = [(4, 3), (3, 1), (4, 1), (2, 1), (6, 7), (7, 6)];
        let found = floors([1, 2, 3, 4, 5, 6, 7].iter(), &edges.into());
        assert_eq!(found, [vec![1, 5], vec![2, 3], vec![4]]);
    }
}
