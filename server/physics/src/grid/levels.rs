//! The hierarchy of composite elements.
//!
//! Level `l` groups 2^l x 2^l x 2^l voxels: an element is one connected component of the voxels of
//! such a cell, so a cell that falls into several parts is duplicated per part. Nodes are shared only
//! where material is connected: the node of an element at a lattice vertex is the connected component
//! of the element corners at that vertex, joined across faces that carry an intact link.
//!
//! Each level is built from the units below it: the base level from voxels, every other one from the
//! elements of the level below. Links only ever part, so elements and nodes only ever split: their
//! ids stay valid, new ids go to the end, and an update costs in proportion to the touched cells.

use super::{Grid, Ijk};

/// "No element" in maps from units to elements.
pub const NONE: u32 = u32::MAX;

/// One composite element.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Element {
    /// Its cell, in units of the level's cell edge.
    pub cell: Ijk,
    /// Its nodes; corner `c` is at `(c & 1, c >> 1 & 1, c >> 2)`.
    pub nodes: [u32; 8],
    /// Elements linked to it, by face (-x, +x, -y, +y, -z, +z).
    pub neighbours: Vec<(u8, u32)>,
    next_in_cell: u32,
    /// Whether it was its cell's only element and filled it when the level was built.
    whole: bool,
}

/// The elements and nodes of one level.
#[derive(Clone, Debug)]
pub struct Level {
    /// log2 of the cell edge in voxels.
    pub exponent: u8,
    /// Elements by id.
    pub elements: Vec<Element>,
    /// Lattice position of each node, in units of the level's cell edge.
    pub nodes: Vec<Ijk>,
    /// Element of each unit below (voxel or element).
    pub owner: Vec<u32>,
    first_in_cell: Vec<u32>,
    dims: [i32; 3],
}

/// What an update of a level changed.
#[derive(Clone, Debug, Default, PartialEq, Eq)]
pub struct LevelChange {
    /// Cells whose elements or their links changed, ascending.
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

/// What a level is built from.
pub trait Units {
    /// Number of units.
    fn len(&self) -> usize;
    /// Whether there is none.
    fn is_empty(&self) -> bool {
        self.len() == 0
    }
    /// Calls `visit` with each unit of a cell of the level above, in a fixed order.
    fn in_cell(&self, cell: Ijk, visit: &mut dyn FnMut(u32));
    /// Whether units fill a cell of the level above wholly.
    fn is_full(&self, cell: Ijk) -> bool;
    /// Calls `visit(face, other)` for each unit linked to `unit`.
    fn neighbours(&self, unit: u32, visit: &mut dyn FnMut(u8, u32));
    /// Cell of the level above that holds `unit`.
    fn cell_above(&self, unit: u32) -> Ijk;
}

/// Voxels as the units of a base level of 2^exponent voxels a side.
pub struct VoxelUnits<'a> {
    /// The voxels.
    pub grid: &'a Grid,
    /// log2 of the base level's cell edge in voxels.
    pub exponent: u8,
}

impl Units for VoxelUnits<'_> {
    fn len(&self) -> usize {
        self.grid.voxels().len()
    }

    fn in_cell(&self, cell: Ijk, visit: &mut dyn FnMut(u32)) {
        let k = 1 << self.exponent;
        for z in cell[2] * k..(cell[2] + 1) * k {
            for y in cell[1] * k..(cell[1] + 1) * k {
                for x in cell[0] * k..(cell[0] + 1) * k {
                    if let Some(voxel) = self.grid.voxel_at([x, y, z]) {
                        visit(voxel.0);
                    }
                }
            }
        }
    }

    fn is_full(&self, cell: Ijk) -> bool {
        let mut count = 0;
        self.in_cell(cell, &mut |_| count += 1);
        count == 1 << (3 * self.exponent)
    }

    fn neighbours(&self, unit: u32, visit: &mut dyn FnMut(u8, u32)) {
        let cell = self.grid.voxels()[unit as usize].ijk;
        for (face, (link, other)) in Grid::links_of(cell).enumerate() {
            if self.grid.is_intact(link)
                && let Some(voxel) = self.grid.voxel_at(other)
            {
                visit(face as u8, voxel.0);
            }
        }
    }

    fn cell_above(&self, unit: u32) -> Ijk {
        self.grid.voxels()[unit as usize].ijk.map(|c| c >> self.exponent)
    }
}

/// The elements of a level as the units of the level above.
impl Units for Level {
    fn len(&self) -> usize {
        self.elements.len()
    }

    fn in_cell(&self, cell: Ijk, visit: &mut dyn FnMut(u32)) {
        for octant in 0..8 {
            self.elements_in([0, 1, 2].map(|a| 2 * cell[a] + (octant >> a & 1))).for_each(&mut *visit);
        }
    }

    fn is_full(&self, cell: Ijk) -> bool {
        let (mut count, mut whole) = (0, true);
        self.in_cell(cell, &mut |unit| {
            count += 1;
            whole &= self.elements[unit as usize].whole;
        });
        whole && count == 8
    }

    fn neighbours(&self, unit: u32, visit: &mut dyn FnMut(u8, u32)) {
        self.elements[unit as usize].neighbours.iter().for_each(|&(face, other)| visit(face, other));
    }

    fn cell_above(&self, unit: u32) -> Ijk {
        self.elements[unit as usize].cell.map(|c| c >> 1)
    }
}

impl Level {
    /// Builds a level over all of `units`, which fill cells `0..dims` of this level.
    #[must_use]
    pub fn build(units: &dyn Units, exponent: u8, dims: [i32; 3]) -> Self {
        let cells = dims.iter().map(|&d| d as usize).product();
        let mut level = Self {
            exponent,
            elements: Vec::new(),
            nodes: Vec::new(),
            owner: Vec::new(),
            first_in_cell: vec![NONE; cells],
            dims,
        };
        let mut touched = Vec::new();
        for z in 0..dims[2] {
            for y in 0..dims[1] {
                for x in 0..dims[0] {
                    touched.push([x, y, z]);
                }
            }
        }
        // Whole cells first: their elements are alike, and stand together.
        touched.sort_by_key(|&cell| !units.is_full(cell));
        level.update_in_order(units, touched);
        for element in &mut level.elements {
            element.whole = units.is_full(element.cell);
        }
        level
    }

    /// Number of cells along each axis.
    #[must_use]
    pub fn dims(&self) -> [i32; 3] {
        self.dims
    }

    fn cell_slot(&self, cell: Ijk) -> Option<usize> {
        let inside = (0..3).all(|a| (0..self.dims[a]).contains(&cell[a]));
        inside.then(|| ((cell[2] * self.dims[1] + cell[1]) * self.dims[0] + cell[0]) as usize)
    }

    /// The elements of a cell, oldest first.
    pub fn elements_in(&self, cell: Ijk) -> impl Iterator<Item = u32> + '_ {
        let mut next = self.cell_slot(cell).map_or(NONE, |slot| self.first_in_cell[slot]);
        std::iter::from_fn(move || {
            let current = next;
            (current != NONE).then(|| {
                next = self.elements[current as usize].next_in_cell;
                current
            })
        })
    }

    /// Recomputes components, neighbours and nodes of `touched` cells.
    pub fn update(&mut self, units: &dyn Units, mut touched: Vec<Ijk>) -> LevelChange {
        touched.sort_unstable_by_key(|c| [c[2], c[1], c[0]]);
        touched.dedup();
        self.update_in_order(units, touched)
    }

    fn update_in_order(&mut self, units: &dyn Units, touched: Vec<Ijk>) -> LevelChange {
        self.owner.resize(units.len(), NONE);
        let mut change = LevelChange::default();
        let mut members = Vec::new();
        for &cell in &touched {
            self.update_components(units, cell, &mut members, &mut change);
        }
        // Most links that part lie inside an element that still hangs together, or between two that are
        // linked elsewhere: then nothing follows from it, here or on the levels above.
        let split: Vec<Ijk> = change.changed_elements.iter().map(|e| self.elements[*e as usize].cell).collect();
        let mut linked = touched;
        linked.extend(split.iter().flat_map(|&cell| Grid::links_of(cell).map(|(_, other)| other)));
        let mut changed = split;
        for cell in sorted(linked) {
            if self.update_neighbours(units, cell) {
                changed.push(cell);
            }
        }
        change.touched_cells = sorted(changed);
        for vertex in corners_of(&change.touched_cells) {
            self.update_nodes(vertex, &mut change);
        }
        change.changed_elements.sort_unstable();
        change.renoded_elements.sort_unstable();
        change.renoded_elements.dedup();
        change
    }

    /// Splits the units of a cell into connected components. A component keeps the element that its
    /// first unit had; a second component of the same element gets a new one.
    fn update_components(&mut self, units: &dyn Units, cell: Ijk, members: &mut Vec<u32>, change: &mut LevelChange) {
        members.clear();
        units.in_cell(cell, &mut |unit| members.push(unit));
        let first_new = self.elements.len() as u32;
        let mut claimed: Vec<u32> = Vec::new();
        let mut seen = vec![false; members.len()];
        let mut stack = Vec::new();
        let mut component = Vec::new();
        for start in 0..members.len() {
            if seen[start] {
                continue;
            }
            seen[start] = true;
            component.clear();
            stack.push(start);
            while let Some(index) = stack.pop() {
                component.push(members[index]);
                units.neighbours(members[index], &mut |_, other| {
                    if units.cell_above(other) == cell
                        && let Some(found) = members.iter().position(|m| *m == other)
                        && !seen[found]
                    {
                        seen[found] = true;
                        stack.push(found);
                    }
                });
            }
            let old = component.iter().map(|u| self.owner[*u as usize]).find(|e| *e != NONE).unwrap_or(NONE);
            let element =
                if old != NONE && !claimed.contains(&old) { old } else { self.add_element(cell, old, change) };
            claimed.push(element);
            component.iter().for_each(|unit| self.owner[*unit as usize] = element);
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
        self.elements.push(Element { cell, nodes, neighbours: Vec::new(), next_in_cell: NONE, whole: false });
        let last = self.elements_in(cell).last();
        match last {
            Some(last) => self.elements[last as usize].next_in_cell = id,
            None => {
                let slot = self.cell_slot(cell).expect("units lie inside the level");
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
        let (elements, owner) = (&mut self.elements, &self.owner);
        units.in_cell(cell, &mut |unit| {
            let own = owner[unit as usize] as usize;
            units.neighbours(unit, &mut |face, other| {
                let entry = (face, owner[other as usize]);
                if units.cell_above(other) != cell && !elements[own].neighbours.contains(&entry) {
                    elements[own].neighbours.push(entry);
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

    /// Recomputes which element corners at a lattice vertex share a node.
    fn update_nodes(&mut self, vertex: Ijk, change: &mut LevelChange) {
        let mut corners: Vec<(u32, usize)> = Vec::with_capacity(8);
        for octant in 0..8usize {
            let cell = [0, 1, 2].map(|a| vertex[a] - 1 + (octant >> a & 1) as i32);
            let corner = 7 - octant;
            corners.extend(self.elements_in(cell).map(|element| (element, corner)));
        }
        let mut claimed: Vec<u32> = Vec::with_capacity(2);
        let mut seen = vec![false; corners.len()];
        let mut stack = Vec::with_capacity(8);
        for start in 0..corners.len() {
            if seen[start] {
                continue;
            }
            seen[start] = true;
            stack.push(start);
            let mut component = Vec::with_capacity(8);
            while let Some(index) = stack.pop() {
                component.push(corners[index]);
                for &(_, other) in &self.elements[corners[index].0 as usize].neighbours {
                    if let Some(found) = corners.iter().position(|c| c.0 == other)
                        && !seen[found]
                    {
                        seen[found] = true;
                        stack.push(found);
                    }
                }
            }
            let old = component.iter().map(|&(e, c)| self.elements[e as usize].nodes[c]).find(|n| *n != NONE);
            let node = match old {
                Some(node) if !claimed.contains(&node) => node,
                _ => {
                    let id = self.nodes.len() as u32;
                    self.nodes.push(vertex);
                    change.split_nodes.extend(old.map(|from| (id, from)));
                    id
                }
            };
            claimed.push(node);
            for (element, corner) in component {
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
    pub fn parts(&self) -> (Vec<u32>, u32) {
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

fn corners_of(cells: &[Ijk]) -> Vec<Ijk> {
    sorted(cells.iter().flat_map(|c| (0..8).map(move |o| [0, 1, 2].map(|a| c[a] + (o >> a & 1)))).collect())
}

fn sorted(mut cells: Vec<Ijk>) -> Vec<Ijk> {
    cells.sort_unstable_by_key(|c| [c[2], c[1], c[0]]);
    cells.dedup();
    cells
}
