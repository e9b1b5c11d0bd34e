//! [`circles`]: the strongly connected components of a graph.

use std::collections::BTreeSet;

/// Returns the sets of two nodes or more in which each node can be reached from each other one.
pub(super) fn circles<N: Ord + Clone>(edges: &BTreeSet<(N, N)>) -> Vec<Vec<N>> {
    let mut circles: Vec<Vec<N>> = Vec::new();
    for (node, _) in edges {
        if circles.iter().any(|circle| circle.contains(node)) {
            continue;
        }
        let mutual = reached(edges, node).into_iter();
        let mutual = mutual.filter(|other| reached(edges, other).contains(node));
        let circle: Vec<N> = mutual.cloned().collect();
        if circle.len() > 1 {
            circles.push(circle);
        }
    }
    circles
}

/// Returns the nodes that can be reached from a node.
fn reached<'e, N: Ord>(edges: &'e BTreeSet<(N, N)>, node: &N) -> BTreeSet<&'e N> {
    let mut reached = BTreeSet::new();
    let mut left: Vec<&N> = Vec::new();
    let mut at = node;
    loop {
        let next = edges.iter().filter(|(from, _)| from == at);
        left.extend(next.map(|(_, to)| to).filter(|to| reached.insert(*to)));
        match left.pop() {
            Some(next) => at = next,
            None => return reached,
        }
    }
}

#[cfg(test)]
mod tests {
    use super::circles;

    #[test]
    fn only_what_reaches_itself_is_a_circle() {
        let edges = [
            (1, 2),
            (2, 3),
            (3, 1),
            (3, 4),
            (4, 5),
            (5, 4),
            (6, 1),
            (7, 7),
        ];
        let mut found = circles(&edges.into());
        for circle in &mut found {
            circle.sort_unstable();
        }
        found.sort_unstable();
        assert_eq!(found, [vec![1, 2, 3], vec![4, 5]]);
        assert!(circles(&[(1, 2), (1, 3), (2, 3)].into()).is_empty());
    }
}
