//! Connected components of a graph over the points.

use crate::progress::{Canceled, Progress};

/// Points handled between two looks at the progress.
const BATCH: usize = 1 << 17;

/// A label per point; components are numbered by their first point.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Components {
    /// Component of every point.
    pub label: Vec<u32>,
    /// Points of every component.
    pub size: Vec<usize>,
}

/// Components of the graph whose edges out of point `i` are `edges(i)`.
///
/// # Errors
/// [`Canceled`].
pub fn components<E: Iterator<Item = u32>>(
    n: usize,
    edges: impl Fn(usize) -> E,
    progress: &Progress,
) -> Result<Components, Canceled> {
    let mut parent: Vec<u32> = (0..n as u32).collect();
    for i in 0..n {
        if i.is_multiple_of(BATCH) {
            progress.checkpoint()?;
        }
        for j in edges(i) {
            let (a, b) = (root(&mut parent, i as u32), root(&mut parent, j));
            // the smaller index leads, so that labels do not depend on the order of edges
            parent[a.max(b) as usize] = a.min(b);
        }
    }
    progress.checkpoint()?;
    let mut size = Vec::new();
    let mut label = vec![0_u32; n];
    for i in 0..n as u32 {
        let leader = root(&mut parent, i);
        if leader == i {
            label[i as usize] = size.len() as u32;
            size.push(0);
        } else {
            label[i as usize] = label[leader as usize];
        }
        size[label[i as usize] as usize] += 1;
    }
    Ok(Components { label, size })
}

fn root(parent: &mut [u32], mut i: u32) -> u32 {
    while parent[i as usize] != i {
        parent[i as usize] = parent[parent[i as usize] as usize];
        i = parent[i as usize];
    }
    i
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn two_paths_and_an_isolated_point_are_three_components() {
        let edges: [&[u32]; 6] = [&[2], &[], &[0, 4], &[5], &[], &[]];
        let found = components(6, |i| edges[i].iter().copied(), &Progress::new()).unwrap();
        assert_eq!(found.label, [0, 1, 0, 2, 0, 2]);
        assert_eq!(found.size, [3, 1, 2]);
    }

    #[test]
    fn no_component_is_told_once_it_is_canceled() {
        let path = |i: usize| (i > 0).then(|| i as u32 - 1).into_iter();
        for looks in [1, 2, 3] {
            let found = components(2 * BATCH, path, &Progress::canceled_after(looks));
            assert_eq!(found, Err(Canceled), "{looks}");
        }
    }
}
