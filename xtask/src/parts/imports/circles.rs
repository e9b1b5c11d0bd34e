//! [`circles`]: the strongly connected components of a graph, by Tarjan's algorithm (1972).

use std::collections::{BTreeMap, BTreeSet};

/// The sets of two nodes or more in which each can be reached from each other.
pub(super) fn circles<N: Ord + Clone>(edges: &BTreeSet<(N, N)>) -> Vec<Vec<N>> {
    let mut search = Search {
        edges,
        numbers: BTreeMap::new(),
        stack: Vec::new(),
        circles: Vec::new(),
    };
    for (from, _) in edges {
        if !search.numbers.contains_key(from) {
            search.visit(from);
        }
    }
    search.circles
}

struct Search<'e, N> {
    edges: &'e BTreeSet<(N, N)>,
    numbers: BTreeMap<&'e N, usize>,
    stack: Vec<&'e N>,
    circles: Vec<Vec<N>>,
}

impl<'e, N: Ord + Clone> Search<'e, N> {
    /// Gives the least number that can be reached from a node and is still on the stack.
    fn visit(&mut self, node: &'e N) -> usize {
        let number = self.numbers.len();
        self.numbers.insert(node, number);
        self.stack.push(node);
        let mut least = number;
        let edges = self.edges;
        for (_, to) in edges.iter().filter(|(from, _)| from == node) {
            match self.numbers.get(to) {
                None => least = least.min(self.visit(to)),
                Some(&other) if self.stack.contains(&to) => least = least.min(other),
                Some(_) => {}
            }
        }
        if least == number {
            let place = self.stack.iter().position(|&it| it == node).unwrap_or(0);
            let circle = self.stack.split_off(place);
            if circle.len() > 1 {
                self.circles.push(circle.into_iter().cloned().collect());
            }
        }
        least
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
