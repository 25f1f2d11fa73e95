//! The positions of the tiles and the arrows between them: the graph of the top-level groups.

mod arrows;
pub mod tile;
pub mod tile_detail;

use std::collections::BTreeSet;

use telltale_engine::model::{GroupId, NodeId};
use telltale_engine::snapshot::{Layout, Snapshot};
use telltale_engine::state::State;

/// Columns and rows that a configuration may ask for; a board with more is laid out by itself.
pub const COLUMNS_MAX: usize = 6;
pub const ROWS_MAX: usize = 4;

/// Index of a tile in [`Board::tiles`].
pub type Tile = usize;
/// Arrows, each from what is depended upon to what depends.
pub type Edges = BTreeSet<(Tile, Tile)>;

/// The tiles in configuration order, their places, and the arrows between them.
#[derive(Debug, Clone, PartialEq)]
pub struct Board {
    pub tiles: Vec<GroupId>,
    /// Column and row of each tile, from 0.
    pub places: Vec<(usize, usize)>,
    pub columns: usize,
    pub rows: usize,
    /// From what is depended upon to what depends.
    pub edges: Vec<(Tile, Tile)>,
    /// The tile that contains each group, if it is in one.
    pub(super) top: Vec<Option<Tile>>,
    /// The tile that contains each module.
    pub(super) module_top: Vec<Option<Tile>>,
}

impl Board {
    pub fn of(layout: &Layout) -> Board {
        let (tiles, top) = tops(layout);
        let module_top = layout.modules.iter().map(|module| top[module.group.0 as usize]).collect();
        let mut board = Board { tiles, top, module_top, ..Board::default() };
        board.edges = board.dependencies(layout).into_iter().collect();
        board.places = board.given_places(layout).unwrap_or_else(|| place(board.tiles.len(), &board.edges));
        board.columns = board.places.iter().map(|place| place.0 + 1).max().unwrap_or(1);
        board.rows = board.places.iter().map(|place| place.1 + 1).max().unwrap_or(1);
        board
    }

    /// The tile in which a node stands.
    pub fn tile_of(&self, node: NodeId) -> Option<Tile> {
        match node {
            NodeId::Group(id) => self.top.get(id.0 as usize).copied().flatten(),
            NodeId::Module(id) => self.module_top.get(id.0 as usize).copied().flatten(),
        }
    }

    /// The arrows that lead from root causes to the tiles that they mask.
    pub fn hot_edges(&self, snapshot: &Snapshot) -> Edges {
        let mut hot = Edges::new();
        for &id in &self.tiles {
            let (_, view) = snapshot.group(id);
            if view.state != State::Ignore {
                continue;
            }
            for path in view.paths.iter() {
                let mut steps: Vec<Tile> = path.iter().filter_map(|&node| self.tile_of(node)).collect();
                steps.dedup();
                hot.extend(steps.windows(2).map(|step| (step[1], step[0])));
            }
        }
        hot
    }

    /// All dependencies between tiles, their own and those of what they contain.
    fn dependencies(&self, layout: &Layout) -> Edges {
        let mut all = Edges::new();
        let groups = layout.groups.iter().zip(&self.top).map(|(group, &top)| (top, &group.depends_on));
        let modules = layout.modules.iter().zip(&self.module_top);
        let modules = modules.map(|(module, &top)| (top, &module.depends_on));
        for (tile, dependencies) in groups.chain(modules) {
            let Some(to) = tile else { continue };
            for on in dependencies {
                let from = on.nodes().iter().filter_map(|&node| self.tile_of(node));
                all.extend(from.filter(|&from| from != to).map(|from| (from, to)));
            }
        }
        all
    }

    /// The places of the configuration, if every tile has one of its own within the bounds.
    fn given_places(&self, layout: &Layout) -> Option<Vec<(usize, usize)>> {
        let mut taken = BTreeSet::new();
        let mut places = Vec::with_capacity(self.tiles.len());
        for id in &self.tiles {
            let group = &layout.groups[id.0 as usize];
            if group.is_other {
                continue;
            }
            let (column, row) = group.tile?;
            let place = (usize::from(column).checked_sub(1)?, usize::from(row).checked_sub(1)?);
            if place.0 >= COLUMNS_MAX || place.1 >= ROWS_MAX || !taken.insert(place) {
                return None;
            }
            places.push(place);
        }
        if self.tiles.iter().any(|id| layout.groups[id.0 as usize].is_other) {
            places.push(free_place(&taken)?);
        }
        Some(places)
    }
}

impl Default for Board {
    fn default() -> Board {
        Board {
            tiles: Vec::new(),
            places: Vec::new(),
            columns: 1,
            rows: 1,
            edges: Vec::new(),
            top: Vec::new(),
            module_top: Vec::new(),
        }
    }
}

/// A place for the tile of undeclared statuses, which the configuration does not place: the first free one
/// among the others, from below, or else one below or beside them.
fn free_place(taken: &BTreeSet<(usize, usize)>) -> Option<(usize, usize)> {
    let columns = taken.iter().map(|place| place.0 + 1).max()?;
    let rows = taken.iter().map(|place| place.1 + 1).max()?;
    let inside = (0..rows).rev().flat_map(|row| (0..columns).map(move |column| (column, row)));
    let outside = [(0, rows), (columns, 0)];
    let bounded = |&(column, row): &(usize, usize)| column < COLUMNS_MAX && row < ROWS_MAX;
    inside.chain(outside).filter(bounded).find(|place| !taken.contains(place))
}

fn tops(layout: &Layout) -> (Vec<GroupId>, Vec<Option<Tile>>) {
    let mut tiles = Vec::new();
    let mut top: Vec<Option<Tile>> = Vec::with_capacity(layout.groups.len());
    for (index, group) in layout.groups.iter().enumerate() {
        top.push(match group.parent {
            // Parents stand before their children, so theirs is known.
            Some(parent) => top[parent.0 as usize],
            None if !group.is_tile() => None,
            None => {
                tiles.push(GroupId(index as u32));
                Some(tiles.len() - 1)
            }
        });
    }
    (tiles, top)
}

/// A layout for tiles without places: left to right along the dependencies where that fits,
/// else filled column by column in the order of dependencies.
fn place(tiles: usize, edges: &[(Tile, Tile)]) -> Vec<(usize, usize)> {
    let columns = match tiles {
        0..=12 => tiles.clamp(1, 4),
        13..=20 => 5,
        _ => COLUMNS_MAX,
    };
    let layers = layers(tiles, edges);
    let depth = layers.iter().max().map_or(0, |last| last + 1);
    let height = (0..depth).map(|layer| layers.iter().filter(|&&l| l == layer).count()).max().unwrap_or(0);
    if (2..=columns).contains(&depth) && height <= 3 {
        return layered(&layers, depth, height, edges);
    }
    let rows = tiles.div_ceil(columns).max(1);
    let mut order: Vec<Tile> = (0..tiles).collect();
    order.sort_by_key(|&tile| layers[tile]);
    let mut places = vec![(0, 0); tiles];
    for (index, tile) in order.into_iter().enumerate() {
        places[tile] = (index / rows, index % rows);
    }
    places
}

/// The length of the longest way to each tile. A circle, which only single modules can make, is cut.
fn layers(tiles: usize, edges: &[(Tile, Tile)]) -> Vec<usize> {
    let mut layers = vec![0; tiles];
    for _ in 0..tiles {
        let mut changed = false;
        for &(from, to) in edges {
            if layers[to] <= layers[from] && layers[from] + 1 < tiles {
                layers[to] = layers[from] + 1;
                changed = true;
            }
        }
        if !changed {
            break;
        }
    }
    layers
}

fn layered(layers: &[usize], depth: usize, height: usize, edges: &[(Tile, Tile)]) -> Vec<(usize, usize)> {
    let mut places: Vec<(usize, usize)> = layers.iter().map(|&layer| (layer, 0)).collect();
    for layer in 0..depth {
        let members: Vec<Tile> = (0..layers.len()).filter(|&tile| layers[tile] == layer).collect();
        let mut free: Vec<usize> = (0..height).collect();
        for tile in members {
            // Beside what it depends on, so that arrows run straight.
            let wanted = edges.iter().filter(|edge| edge.1 == tile && layers[edge.0] < layer);
            let wanted = wanted.map(|edge| places[edge.0].1).min().unwrap_or(0);
            let best = (0..free.len()).min_by_key(|&index| free[index].abs_diff(wanted)).unwrap_or(0);
            places[tile].1 = free.remove(best);
        }
    }
    places
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn any_number_of_tiles_gets_places_of_their_own() {
        for tiles in 0..=40 {
            let chain: Vec<_> = (1..tiles).map(|tile| (tile - 1, tile)).collect();
            let star: Vec<_> = (1..tiles).map(|tile| (0, tile)).collect();
            let circle: Vec<_> = (0..tiles).map(|tile| (tile, (tile + 1) % tiles)).collect();
            for edges in [vec![], chain, star, circle] {
                let places = place(tiles, &edges);
                assert_eq!(BTreeSet::from_iter(&places).len(), tiles, "{edges:?}");
                assert!(places.iter().all(|place| place.0 < COLUMNS_MAX), "{edges:?}");
            }
        }
    }

    #[test]
    fn dependencies_run_left_to_right_where_they_fit() {
        assert_eq!(place(4, &[(0, 1), (1, 2), (3, 2)]), [(0, 0), (1, 0), (2, 0), (0, 1)]);
    }
}
