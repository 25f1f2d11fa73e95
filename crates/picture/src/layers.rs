//! The layout of a graph: boxes in columns by what they depend on, with waypoints where arrows pass a column.

use std::collections::HashMap;

use telltale_engine::model::GroupId;

/// How often the columns are sorted by their connections.
const SWEEPS: usize = 6;

#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Item {
    Box(GroupId),
    /// An arrow passes here: the index of its edge.
    Waypoint(usize),
}

#[derive(Debug)]
pub struct Layers {
    /// From left to right, each from top to bottom, with the distance of each item from the top.
    pub columns: Vec<Vec<(Item, f64)>>,
    pub height: f64,
    waypoint_height: f64,
}

impl Layers {
    /// Boxes with their heights; `edges` lead from a left box to a box right of it.
    pub fn of(
        boxes: &[(GroupId, f64)],
        edges: &[(GroupId, GroupId)],
        gap: f64,
        waypoint_height: f64,
    ) -> Layers {
        let column = columns(boxes, edges);
        let count = column.values().max().map_or(0, |last| last + 1);
        let mut items: Vec<Vec<Item>> = vec![Vec::new(); count];
        for (id, _) in boxes {
            items[column[id]].push(Item::Box(*id));
        }
        let mut links: Vec<(Item, Item)> = Vec::new();
        for (index, (left, right)) in edges.iter().enumerate() {
            let mut at = Item::Box(*left);
            for between in items.iter_mut().take(column[right]).skip(column[left] + 1) {
                between.push(Item::Waypoint(index));
                links.push((at, Item::Waypoint(index)));
                at = Item::Waypoint(index);
            }
            links.push((at, Item::Box(*right)));
        }
        sort(&mut items, &links);
        let heights: HashMap<GroupId, f64> = boxes.iter().copied().collect();
        place(&items, &heights, gap, waypoint_height)
    }

    /// The column and the height of each waypoint of an edge, from left to right.
    pub fn waypoints(&self, edge: usize, margin: f64) -> Vec<(usize, f64)> {
        let waypoint = |(column, items): (usize, &Vec<(Item, f64)>)| {
            let found = items.iter().find(|(item, _)| *item == Item::Waypoint(edge));
            found.map(|(_, top)| (column, margin + top + self.waypoint_height / 2.0))
        };
        self.columns.iter().enumerate().filter_map(waypoint).collect()
    }
}

/// One column right of everything that it depends on. Boxes whose modules depend on each other crosswise
/// have no such order: they are pushed right as often as there are boxes, and then stay.
fn columns(boxes: &[(GroupId, f64)], edges: &[(GroupId, GroupId)]) -> HashMap<GroupId, usize> {
    let mut column: HashMap<GroupId, usize> = boxes.iter().map(|(id, _)| (*id, 0)).collect();
    for _ in 0..boxes.len() {
        for (left, right) in edges.iter().filter(|(left, right)| left != right) {
            let least = (column[left] + 1).min(boxes.len() - 1);
            column.entry(*right).and_modify(|at| *at = least.max(*at));
        }
    }
    // Without empty columns, which a circle leaves.
    let mut used: Vec<usize> = column.values().copied().collect();
    used.sort_unstable();
    used.dedup();
    for at in column.values_mut() {
        *at = used.binary_search(at).unwrap_or(0);
    }
    column
}

/// Puts each item near its connections, in turn from the left and from the right.
fn sort(columns: &mut [Vec<Item>], links: &[(Item, Item)]) {
    for sweep in 0..SWEEPS {
        let from_left = sweep % 2 == 0;
        let order: Vec<usize> = if from_left {
            (1..columns.len()).collect()
        } else {
            (0..columns.len().saturating_sub(1)).rev().collect()
        };
        for column in order {
            let beside = &columns[if from_left { column - 1 } else { column + 1 }];
            let place = |wanted: Item| beside.iter().position(|item| *item == wanted);
            let middle = |item: Item| {
                let ends = links.iter().filter_map(|&(left, right)| {
                    let (here, there) = if from_left { (right, left) } else { (left, right) };
                    (here == item).then(|| place(there)).flatten()
                });
                let ends: Vec<usize> = ends.collect();
                (!ends.is_empty()).then(|| ends.iter().sum::<usize>() as f64 / ends.len() as f64)
            };
            let mut keys: Vec<(Item, f64)> = columns[column]
                .iter()
                .enumerate()
                .map(|(index, &item)| (item, middle(item).unwrap_or(index as f64)))
                .collect();
            keys.sort_by(|a, b| a.1.total_cmp(&b.1));
            columns[column] = keys.into_iter().map(|(item, _)| item).collect();
        }
    }
}

fn place(items: &[Vec<Item>], heights: &HashMap<GroupId, f64>, gap: f64, waypoint_height: f64) -> Layers {
    let height = |item: &Item| match item {
        Item::Box(id) => heights[id] + gap,
        Item::Waypoint(_) => waypoint_height,
    };
    let total = |column: &Vec<Item>| column.iter().map(height).sum::<f64>();
    let tallest = items.iter().map(total).fold(0.0, f64::max);
    let columns = items
        .iter()
        .map(|column| {
            let mut top = (tallest - total(column)) / 2.0;
            let placed = column.iter().map(|&item| {
                let at = top;
                top += height(&item);
                (item, at)
            });
            placed.collect()
        })
        .collect();
    Layers { columns, height: tallest, waypoint_height }
}
