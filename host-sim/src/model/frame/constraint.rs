//! How every degree of freedom follows the free ones.
//!
//! `u = T q`: `u` are all degrees of freedom of all nodes, `q` the free ones. Each row of `T` is kept as the few
//! coefficients that are not zero: one for a free degree of freedom, none for a held one, and for the slave of a link those
//! of its master, moved by the arm between them.

use anyhow::{Result, bail};

use super::element::carried;
use super::{DIRECTIONS, Follows, Frame, NODE_FREEDOMS};

/// A linear form over the free degrees of freedom: pairs of number and coefficient, by ascending number.
pub type Row = Vec<(usize, f64)>;

/// The sum of `parts`, each a coefficient and a row.
pub fn combine<'a>(parts: impl IntoIterator<Item = (f64, &'a Row)>) -> Row {
    let mut sum = Row::new();
    for (factor, row) in parts {
        for &(freedom, value) in row {
            match sum.binary_search_by_key(&freedom, |&(known, _)| known) {
                Ok(at) => sum[at].1 += factor * value,
                Err(at) => sum.insert(at, (freedom, factor * value)),
            }
        }
    }
    sum.retain(|&(_, value)| value != 0.0);
    sum
}

/// The rows of `T`, six a node, and the number of free degrees of freedom.
pub fn rows(frame: &Frame) -> Result<(Vec<[Row; NODE_FREEDOMS]>, usize)> {
    let name = |node: usize| &frame.nodes[node].name;
    // What each degree of freedom follows: coefficients of others.
    let mut follows: Vec<Option<Vec<(usize, f64)>>> = vec![None; NODE_FREEDOMS * frame.nodes.len()];
    for link in &frame.links {
        if link.master == link.slave {
            bail!("node \"{}\" is linked to itself: delete the link", name(link.slave));
        }
        let arm = carried(frame.nodes[link.slave].place_m - frame.nodes[link.master].place_m);
        for direction in 0..NODE_FREEDOMS {
            let mut of = vec![(NODE_FREEDOMS * link.master + direction, 1.0)];
            match link.follows {
                Follows::Equally(marked) if !marked[direction] => continue,
                Follows::Rigidly if direction < 3 => of.extend(
                    (0..3)
                        .map(|axis| (NODE_FREEDOMS * link.master + 3 + axis, arm[(direction, axis)]))
                        .filter(|&(_, value)| value != 0.0),
                ),
                _ => {}
            }
            let slave = &mut follows[NODE_FREEDOMS * link.slave + direction];
            if slave.is_some() {
                bail!(
                    "node \"{}\" follows two masters in {}: keep one of its links",
                    name(link.slave),
                    DIRECTIONS[direction]
                );
            }
            if frame.nodes[link.slave].held[direction] {
                bail!(
                    "node \"{}\" is held in {} but also linked to node \"{}\": hold the master instead",
                    name(link.slave),
                    DIRECTIONS[direction],
                    name(link.master)
                );
            }
            *slave = Some(of);
        }
    }

    let mut count = 0;
    let mut known: Vec<Option<Row>> = vec![None; follows.len()];
    for (freedom, row) in known.iter_mut().enumerate() {
        if frame.nodes[freedom / NODE_FREEDOMS].held[freedom % NODE_FREEDOMS] {
            *row = Some(Row::new());
        } else if follows[freedom].is_none() {
            *row = Some(vec![(count, 1.0)]);
            count += 1;
        }
    }
    // Chains of links: each pass resolves at least one link of every chain that has an end.
    loop {
        let mut resolved = 0;
        for freedom in 0..follows.len() {
            let (None, Some(of)) = (&known[freedom], &follows[freedom]) else {
                continue;
            };
            let parts: Option<Vec<(f64, &Row)>> = (of.iter())
                .map(|&(master, value)| known[master].as_ref().map(|row| (value, row)))
                .collect();
            if let Some(parts) = parts {
                known[freedom] = Some(combine(parts));
                resolved += 1;
            }
        }
        if resolved == 0 {
            break;
        }
    }
    if let Some(freedom) = known.iter().position(Option::is_none) {
        bail!(
            "the links of node \"{}\" lead in a circle: let one node of it be the master of the others",
            name(freedom / NODE_FREEDOMS)
        );
    }
    let mut all = known.into_iter().flatten();
    let rows = frame
        .nodes
        .iter()
        .map(|_| std::array::from_fn(|_| all.next().unwrap_or_default()))
        .collect();
    Ok((rows, count))
}
