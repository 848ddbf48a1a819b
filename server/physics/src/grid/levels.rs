//! The hierarchy of composite elements.
//!
//! Level `l` groups 2^l x 2^l x 2^l voxels: an element is one connected component of the voxels of
//! such a cell, so a cell that falls into several parts is duplicated per part. Nodes are shared only
//! where material is connected: the node of an element at a lattice vertex is the connected component
//! of the element corners at that vertex, joined across faces that carry an intact link.
//!
//! The base level may be finer in some regions: its cells are then of 1, 2, 4, ... lattice cells a side,
//! and cells that touch differ by a factor of at most two. A node of small cells on the face or edge of a
//! larger one *hangs*: it goes where the larger element's corners take it.
//!
//! Each level is built from the units below it: the base level from voxels, every other one from the
//! elements of the level below; the smallest cells grow by a factor of two from level to level, the
//! others stay until they are the smallest. Links only ever part, so elements and nodes only ever split: their
//! ids stay valid, new ids go to the end, and an update costs in proportion to the touched cells.

use super::Ijk;
use super::cell_sizes::CellSizes;
use super::units::{Units, VoxelUnits};
use crate::Vec3;
use crate::fem::composite::shape_functions;
use serde::{Deserialize, Serialize};

/// "No element" in maps from units to elements.
pub const NONE: u32 = u32::MAX;

/// Owner of a unit whose component is being sought.
const OPEN: u32 = NONE - 1;

/// Elements that a solver takes at a time.
const ROW_ELEMENTS: usize = 8;
/// A brick is this many rows of cells high and deep.
const BRICK_ROWS: i32 = 4;

/// One composite element.
#[derive(Clone, Debug, PartialEq, Eq, Serialize, Deserialize)]
pub struct Element {
    /// The lower corner of its cell, in lattice cells of the level.
    pub cell: Ijk,
    /// Edge of its cell, in lattice cells of the level.
    pub size: i32,
    /// Its nodes; corner `c` is at `(c & 1, c >> 1 & 1, c >> 2)`.
    pub nodes: [u32; 8],
    /// Elements linked to it, by face (-x, +x, -y, +y, -z, +z).
    pub neighbours: Vec<(u8, u32)>,
    next_in_cell: u32,
    /// Whether it was its cell's only element and filled it when the level was built.
    whole: bool,
}

/// Where an element is, and its nodes.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) struct ElementPlace {
    /// As [`Element::cell`].
    pub(crate) cell: Ijk,
    /// As [`Element::size`].
    pub(crate) size: i32,
    /// As [`Element::nodes`].
    pub(crate) nodes: [u32; 8],
}

impl Element {
    /// Where it is, and its nodes.
    pub(crate) fn place(&self) -> ElementPlace {
        ElementPlace { cell: self.cell, size: self.size, nodes: self.nodes }
    }
}

impl ElementPlace {
    /// Coordinates in the cell, 0..=1 inside it, of a point given in lattice cells of the level.
    pub(crate) fn local_coordinates(&self, at: &Vec3) -> [f64; 3] {
        [0, 1, 2].map(|a| (at[a] - f64::from(self.cell[a])) / f64::from(self.size))
    }
}

/// The elements and nodes of one level.
#[derive(Clone, Debug, Serialize, Deserialize)]
pub struct Level {
    /// log2 of the lattice cell's edge in voxels: of the smallest element's.
    pub exponent: u8,
    /// Elements by id.
    pub elements: Vec<Element>,
    /// Lattice position of each node.
    pub nodes: Vec<Ijk>,
    /// For each node the larger element on whose face or edge it hangs, or [`NONE`].
    hosts: Vec<u32>,
    /// Element of each unit below (voxel or element).
    pub owner: Vec<u32>,
    first_in_cell: Vec<u32>,
    sizes: CellSizes,
}

/// A node that goes where others take it.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct HangingNode {
    /// The node.
    pub node: u32,
    /// Corners of the larger element, and how much each counts; weights of zero fill up.
    pub masters: [(u32, f32); 4],
}

/// What an update of a level changed.
#[derive(Clone, Debug, Default, PartialEq, Eq)]
pub struct LevelChange {
    /// Lower corners of cells whose elements or their links changed, ascending.
    pub touched_cells: Vec<Ijk>,
    /// Elements whose units changed, ascending; new ones included.
    pub changed_elements: Vec<u32>,
    /// New elements and the elements they split from.
    pub split_elements: Vec<(u32, u32)>,
    /// New nodes and the nodes they split from.
    pub split_nodes: Vec<(u32, u32)>,
    /// Elements one of whose nodes changed, ascending.
    pub renoded_elements: Vec<u32>,
}

impl LevelChange {
    /// Elements that are new or have other units or nodes than before, ascending.
    #[must_use]
    pub(crate) fn elements(&self) -> Vec<u32> {
        let mut elements: Vec<u32> = self.changed_elements.iter().chain(&self.renoded_elements).copied().collect();
        elements.sort_unstable();
        elements.dedup();
        elements
    }
}

/// Units of a cell while its components are sought: scratch.
#[derive(Default)]
struct Members {
    /// And the elements they were in.
    units: Vec<(u32, u32)>,
    stack: Vec<u32>,
}

/// The elements of a level as the units of the level above.
impl Units for Level {
    fn len(&self) -> usize {
        self.elements.len()
    }

    fn in_cell(&self, cell: Ijk, size: i32, visit: &mut dyn FnMut(u32)) {
        // Eight cells of the smallest size grow into one; a larger one is taken over as it is.
        let first = cell.map(|c| 2 * c);
        let cells = if self.sizes.at(first) == Some(2 * size) { 1 } else { 8 };
        for octant in 0..cells {
            self.elements_in([0, 1, 2].map(|a| first[a] + (octant >> a & 1))).for_each(&mut *visit);
        }
    }

    fn is_full(&self, cell: Ijk, size: i32) -> bool {
        let mut volume = 0;
        self.in_cell(cell, size, &mut |unit| {
            let element = &self.elements[unit as usize];
            volume += if element.whole { element.size.pow(3) } else { 0 };
        });
        volume == (2 * size).pow(3)
    }

    fn neighbours(&self, unit: u32, visit: &mut dyn FnMut(u8, u32)) {
        self.elements[unit as usize].neighbours.iter().for_each(|&(face, other)| visit(face, other));
    }
}

impl Level {
    /// Builds a base level of cells of `sizes` over all voxels of `units`.
    #[must_use]
    pub(crate) fn base(units: &VoxelUnits<'_>, sizes: CellSizes) -> Self {
        Self::build(units, units.exponent, sizes)
    }

    /// Builds the level above.
    #[must_use]
    pub(crate) fn above(&self) -> Self {
        Self::build(self, self.exponent + 1, self.sizes.grown())
    }

    fn build(units: &dyn Units, exponent: u8, sizes: CellSizes) -> Self {
        let mut level = Self {
            exponent,
            elements: Vec::new(),
            nodes: Vec::new(),
            hosts: Vec::new(),
            owner: Vec::new(),
            first_in_cell: vec![NONE; sizes.len()],
            sizes,
        };
        let mut touched: Vec<(Ijk, i32)> = level.sizes.lattice().filter_map(|c| level.sizes.cell_of(c)).collect();
        touched.sort_by_key(|(c, _)| [c[2], c[1], c[0]]);
        touched.dedup();
        level.update_in_order(units, in_working_order(units, touched));
        for element in &mut level.elements {
            element.whole = units.is_full(element.cell, element.size);
        }
        level
    }

    /// Whether what was read from a file fits together over so many units, and to this level of the scene, whose cells
    /// stay as they are; else what does not.
    pub(crate) fn check(&self, like: &Self, units: usize) -> Result<(), &'static str> {
        let (elements, nodes) = (self.elements.len(), self.nodes.len());
        let is_element = |id: &u32| (*id as usize) < elements;
        let may_be_element = |id: &u32| *id == NONE || is_element(id);
        let fits = |(id, element): (usize, &Element)| {
            // Those of a cell follow each other from the oldest on.
            let follows = element.next_in_cell == NONE || element.next_in_cell as usize > id;
            self.sizes.at(element.cell) == Some(element.size)
                && element.nodes.iter().all(|node| (*node as usize) < nodes)
                && element.neighbours.iter().all(|(face, other)| *face < 6 && is_element(other))
                && follows
                && may_be_element(&element.next_in_cell)
        };
        // One after the other: elements are looked up among cells that fit.
        let checks: [(&dyn Fn() -> bool, &str); 5] = [
            (&|| self.exponent == like.exponent && self.sizes == like.sizes, "cells"),
            (&|| self.elements.iter().enumerate().all(fits), "elements"),
            (
                &|| self.first_in_cell.len() == self.sizes.len() && self.first_in_cell.iter().all(may_be_element),
                "elements of cells",
            ),
            (&|| self.owner.len() == units && self.owner.iter().all(is_element), "units"),
            (&|| self.hosts.len() == nodes && self.hosts.iter().all(may_be_element), "nodes"),
        ];
        checks.into_iter().try_for_each(|(holds, what)| if holds() { Ok(()) } else { Err(what) })
    }

    /// Number of lattice cells along each axis.
    #[must_use]
    pub(crate) fn dims(&self) -> [i32; 3] {
        self.sizes.dims
    }

    /// How lattice cells are grouped into the elements' cells.
    #[must_use]
    pub(crate) fn sizes(&self) -> &CellSizes {
        &self.sizes
    }

    /// Nodes that hang, ascending.
    pub(crate) fn hanging(&self) -> impl Iterator<Item = HangingNode> + '_ {
        (0..self.nodes.len() as u32).filter_map(|node| self.hanging_node(node))
    }

    /// What moves a node, if it hangs.
    #[must_use]
    pub(crate) fn hanging_node(&self, node: u32) -> Option<HangingNode> {
        let host = self.hosts[node as usize];
        if host == NONE {
            return None;
        }
        let element = &self.elements[host as usize];
        let at = self.nodes[node as usize];
        let local = [0, 1, 2].map(|a| f64::from(at[a] - element.cell[a]) / f64::from(element.size));
        let mut masters = [(node, 0.0); 4];
        let weights = shape_functions(local).into_iter().zip(element.nodes).filter(|(w, _)| *w != 0.0);
        for (slot, (weight, master)) in masters.iter_mut().zip(weights) {
            *slot = (master, weight as f32);
        }
        Some(HangingNode { node, masters })
    }

    /// log2 of an element's edge in voxels.
    #[must_use]
    pub(crate) fn exponent_of(&self, element: usize) -> u8 {
        self.exponent + self.elements[element].size.ilog2() as u8
    }

    /// Whether some node hangs.
    #[must_use]
    pub(crate) fn is_graded(&self) -> bool {
        self.hosts.iter().any(|host| *host != NONE)
    }

    /// The elements of the cell with this lower corner, oldest first.
    pub(crate) fn elements_in(&self, cell: Ijk) -> impl Iterator<Item = u32> + '_ {
        let mut next = self.sizes.slot(cell).map_or(NONE, |slot| self.first_in_cell[slot]);
        std::iter::from_fn(move || {
            let current = next;
            (current != NONE).then(|| {
                next = self.elements[current as usize].next_in_cell;
                current
            })
        })
    }

    /// The elements of the cells that hold voxels, each once.
    pub(crate) fn elements_beside(&self, voxels: impl Iterator<Item = Ijk>) -> Vec<u32> {
        let mut cells: Vec<Ijk> = Vec::with_capacity(8);
        for (cell, _) in voxels.filter_map(|voxel| self.sizes.cell_of(voxel.map(|c| c >> self.exponent))) {
            if !cells.contains(&cell) {
                cells.push(cell);
            }
        }
        cells.into_iter().flat_map(|cell| self.elements_in(cell)).collect()
    }

    /// Recomputes components, neighbours and nodes of the cells that hold `touched` lattice cells.
    pub(crate) fn update(&mut self, units: &dyn Units, touched: impl Iterator<Item = Ijk>) -> LevelChange {
        let cells = touched.filter_map(|cell| self.sizes.cell_of(cell)).map(|c| c.0).collect();
        self.update_in_order(units, sorted(cells))
    }

    fn update_in_order(&mut self, units: &dyn Units, touched: Vec<Ijk>) -> LevelChange {
        self.owner.resize(units.len(), NONE);
        let mut change = LevelChange::default();
        let mut members = Members::default();
        for &cell in &touched {
            self.update_components(units, cell, &mut members, &mut change);
        }
        // Most links that part lie inside an element that still hangs together, or between two that are
        // linked elsewhere: then nothing follows from it, here or on the levels above.
        let split: Vec<Ijk> = change.changed_elements.iter().map(|e| self.elements[*e as usize].cell).collect();
        let mut linked = touched;
        linked.extend(split.iter().flat_map(|&cell| self.cells_beside(cell)));
        let mut changed = split;
        for cell in sorted(linked) {
            if self.update_neighbours(units, cell) {
                changed.push(cell);
            }
        }
        change.touched_cells = sorted(changed);
        for vertex in self.vertices_of(&change.touched_cells) {
            self.update_nodes(vertex, &mut change);
        }
        change.changed_elements.sort_unstable();
        change.renoded_elements.sort_unstable();
        change.renoded_elements.dedup();
        change
    }

    /// Splits the units of a cell into connected components. The first component of an element's units keeps the
    /// element, every other gets a new one: links only part, so no component has units of two elements.
    fn update_components(&mut self, units: &dyn Units, cell: Ijk, members: &mut Members, change: &mut LevelChange) {
        members.units.clear();
        let size = self.size_of(cell);
        units.in_cell(cell, size, &mut |unit| {
            members.units.push((unit, std::mem::replace(&mut self.owner[unit as usize], OPEN)));
        });
        let first_new = self.elements.len() as u32;
        let mut claimed: Vec<u32> = Vec::new();
        for &(start, old) in &members.units {
            if self.owner[start as usize] != OPEN {
                continue;
            }
            let is_kept = old != NONE && !claimed.contains(&old);
            let element = if is_kept { old } else { self.add_element(cell, old, change) };
            claimed.push(element);
            self.owner[start as usize] = element;
            members.stack.push(start);
            while let Some(unit) = members.stack.pop() {
                units.neighbours(unit, &mut |_, other| {
                    let owner = &mut self.owner[other as usize];
                    if *owner == OPEN {
                        *owner = element;
                        members.stack.push(other);
                    }
                });
            }
        }
        // An element's units changed if it is new or if another one split from it.
        for &element in &claimed {
            let split = change.split_elements.iter().rev().any(|&(new, old)| new >= first_new && old == element);
            if element >= first_new || split {
                change.changed_elements.push(element);
            }
        }
    }

    fn add_element(&mut self, cell: Ijk, split_from: u32, change: &mut LevelChange) -> u32 {
        let id = self.elements.len() as u32;
        let nodes = if split_from == NONE { [NONE; 8] } else { self.elements[split_from as usize].nodes };
        let (size, neighbours) = (self.size_of(cell), Vec::new());
        self.elements.push(Element { cell, size, nodes, neighbours, next_in_cell: NONE, whole: false });
        let last = self.elements_in(cell).last();
        match last {
            Some(last) => self.elements[last as usize].next_in_cell = id,
            None => {
                let slot = self.sizes.slot(cell).expect("units lie inside the level");
                self.first_in_cell[slot] = id;
            }
        }
        if split_from != NONE {
            change.split_elements.push((id, split_from));
        }
        id
    }

    /// Recomputes which elements those of a cell are linked to; returns whether that changed.
    fn update_neighbours(&mut self, units: &dyn Units, cell: Ijk) -> bool {
        let ids: Vec<u32> = self.elements_in(cell).collect();
        if ids.is_empty() {
            return false;
        }
        let before: Vec<_> = ids.iter().map(|id| std::mem::take(&mut self.elements[*id as usize].neighbours)).collect();
        let (elements, owner, size) = (&mut self.elements, &self.owner, self.sizes.at(cell).unwrap_or(1));
        units.in_cell(cell, size, &mut |unit| {
            let own = owner[unit as usize];
            units.neighbours(unit, &mut |face, other| {
                let entry = (face, owner[other as usize]);
                if elements[entry.1 as usize].cell != cell && !elements[own as usize].neighbours.contains(&entry) {
                    elements[own as usize].neighbours.push(entry);
                }
            });
        });
        let mut changed = false;
        for (id, before) in ids.into_iter().zip(before) {
            let neighbours = &mut self.elements[id as usize].neighbours;
            neighbours.sort_unstable();
            changed |= *neighbours != before;
        }
        changed
    }

    fn size_of(&self, cell: Ijk) -> i32 {
        self.sizes.at(cell).expect("cells lie inside the level")
    }

    /// Lower corners of the cells that share a face with `cell`; some may come more than once.
    fn cells_beside(&self, cell: Ijk) -> Vec<Ijk> {
        let size = self.size_of(cell);
        let mut beside = Vec::with_capacity(6 * (size * size) as usize);
        for axis in 0..3 {
            let (u, v) = ((axis + 1) % 3, (axis + 2) % 3);
            for (step, i, j) in
                [-1, size].into_iter().flat_map(|s| (0..size).flat_map(move |i| (0..size).map(move |j| (s, i, j))))
            {
                let mut at = cell;
                at[axis] += step;
                at[u] += i;
                at[v] += j;
                beside.extend(self.sizes.cell_of(at).map(|c| c.0));
            }
        }
        beside
    }

    /// Lattice points on the surfaces of `cells`, each once.
    fn vertices_of(&self, cells: &[Ijk]) -> Vec<Ijk> {
        let mut vertices = Vec::with_capacity(8 * cells.len());
        for cell in cells {
            let size = self.size_of(*cell);
            let points = 0..=size;
            for (z, y, x) in
                points.clone().flat_map(|z| (0..=size).flat_map(move |y| (0..=size).map(move |x| (z, y, x))))
            {
                if [x, y, z].into_iter().any(|c| c == 0 || c == size) {
                    vertices.push([cell[0] + x, cell[1] + y, cell[2] + z]);
                }
            }
        }
        sorted(vertices)
    }

    /// The elements around a lattice point, each once, and which corner of each the point is; none where
    /// it lies on a face or an edge.
    fn elements_around(&self, vertex: Ijk) -> Vec<(u32, Option<usize>)> {
        let mut around: Vec<(u32, Option<usize>)> = Vec::with_capacity(8);
        for octant in 0..8 {
            let beside = [0, 1, 2].map(|a| vertex[a] - 1 + (octant >> a & 1));
            let Some((cell, size)) = self.sizes.cell_of(beside) else { continue };
            let is_corner = (0..3).all(|a| vertex[a] == cell[a] || vertex[a] == cell[a] + size);
            let corner = is_corner.then_some(7 - octant as usize);
            for element in self.elements_in(cell) {
                if is_corner || !around.iter().any(|(other, _)| *other == element) {
                    around.push((element, corner));
                }
            }
        }
        around
    }

    /// Recomputes which element corners at a lattice point share a node, and whether it hangs.
    fn update_nodes(&mut self, vertex: Ijk, change: &mut LevelChange) {
        let around = self.elements_around(vertex);
        let mut claimed: Vec<u32> = Vec::with_capacity(2);
        let mut seen = vec![false; around.len()];
        let mut stack = Vec::with_capacity(8);
        for start in 0..around.len() {
            if seen[start] {
                continue;
            }
            seen[start] = true;
            stack.push(start);
            let mut corners = Vec::with_capacity(8);
            let mut host = NONE;
            while let Some(index) = stack.pop() {
                match around[index] {
                    (element, Some(corner)) => corners.push((element, corner)),
                    (element, None) => host = host.min(element),
                }
                for &(_, other) in &self.elements[around[index].0 as usize].neighbours {
                    if let Some(found) = around.iter().position(|c| c.0 == other)
                        && !seen[found]
                    {
                        seen[found] = true;
                        stack.push(found);
                    }
                }
            }
            if corners.is_empty() {
                continue;
            }
            let old = corners.iter().map(|&(e, c)| self.elements[e as usize].nodes[c]).find(|n| *n != NONE);
            let node = match old {
                Some(node) if !claimed.contains(&node) => node,
                _ => {
                    let id = self.nodes.len() as u32;
                    self.nodes.push(vertex);
                    self.hosts.push(NONE);
                    change.split_nodes.extend(old.map(|from| (id, from)));
                    id
                }
            };
            claimed.push(node);
            self.hosts[node as usize] = host;
            for (element, corner) in corners {
                let slot = &mut self.elements[element as usize].nodes[corner];
                if *slot != node {
                    *slot = node;
                    change.renoded_elements.push(element);
                }
            }
        }
    }

    /// Components of the whole level: a number for each element, and how many there are. Elements
    /// that touch only through a shared node of a third belong together, as the neighbours say.
    #[must_use]
    pub(crate) fn parts(&self) -> (Vec<u32>, u32) {
        let mut part = vec![NONE; self.elements.len()];
        let mut count = 0;
        let mut stack = Vec::new();
        for start in 0..part.len() {
            if part[start] != NONE {
                continue;
            }
            part[start] = count;
            stack.push(start);
            while let Some(element) = stack.pop() {
                for &(_, other) in &self.elements[element].neighbours {
                    if part[other as usize] == NONE {
                        part[other as usize] = count;
                        stack.push(other as usize);
                    }
                }
            }
            count += 1;
        }
        (part, count)
    }
}

/// The order in which a level numbers the elements of cells. Whole cells of a size first: their elements
/// are alike, and stand together. Of these, rows along x as long as a solver's block come before what is
/// left of them, since the nodes of such a row follow each other. Within all that by bricks of rows,
/// whose elements share most of their nodes.
fn in_working_order(units: &dyn Units, mut cells: Vec<(Ijk, i32)>) -> Vec<Ijk> {
    cells.sort_unstable_by_key(|&(c, size)| (size, c[2], c[1], c[0]));
    let brick = |c: Ijk, size: i32| [c[2] / size / BRICK_ROWS, c[1] / size / BRICK_ROWS];
    let mut keyed = Vec::with_capacity(cells.len());
    let mut row: Vec<Ijk> = Vec::new();
    for (index, &(cell, size)) in cells.iter().enumerate() {
        let full = units.is_full(cell, size);
        if full {
            row.push(cell);
        } else {
            keyed.push((2, size, brick(cell, size), cell));
        }
        let next = [cell[0] + size, cell[1], cell[2]];
        if !full || cells.get(index + 1) != Some(&(next, size)) {
            let in_blocks = row.len() / ROW_ELEMENTS * ROW_ELEMENTS;
            keyed.extend(row.drain(..).enumerate().map(|(i, c)| (u8::from(i >= in_blocks), size, brick(c, size), c)));
        }
    }
    keyed.sort_by_key(|&(rank, size, brick, c)| (rank, size, brick, c[2], c[1], c[0]));
    keyed.into_iter().map(|k| k.3).collect()
}

fn sorted(mut cells: Vec<Ijk>) -> Vec<Ijk> {
    cells.sort_unstable_by_key(|c| [c[2], c[1], c[0]]);
    cells.dedup();
    cells
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::grid::voxelize::voxelize;
    use crate::scene::SceneDesc;

    const SCENE: &str = r#"
        version = 1
        name = "block"
        [[objects]]
        name = "block"
        shape = { box = { min_m = [0.0, 0.0, 0.0], max_m = [0.04, 0.04, 0.04] } }
        voxel_size_m = 0.01
        material = { young_modulus_pa = 1e5, poisson_ratio = 0.4 }
    "#;

    #[test]
    fn cells_of_a_file_that_are_none_are_refused_before_elements_are_looked_up_in_them() {
        let desc = SceneDesc::from_toml("block.toml", SCENE).unwrap();
        let grid = voxelize(&desc.objects[0], &Default::default()).unwrap();
        let level = Level::base(&VoxelUnits { grid: &grid, exponent: 0 }, CellSizes::uniform(grid.dims()));
        let units = grid.voxels().len();
        assert_eq!(level.check(&level, units), Ok(()));
        let mut damaged = level.clone();
        damaged.sizes.dims = [i32::MAX; 3];
        assert_eq!(damaged.check(&level, units), Err("cells"));
        // Lattice cells of so many voxels have no number.
        let mut damaged = level.clone();
        damaged.exponent = 32;
        assert_eq!(damaged.check(&level, units), Err("cells"));
    }
}
