//! Ways around walls: the shortest on a grid, then straight from corner to corner.

use std::cmp::Reverse;
use std::collections::BinaryHeap;

use echogrid_core::World;

/// Side of a cell, metres; larger where the world has no room for so many.
const CELL_M: f64 = 0.05;
/// Most cells of a plan.
const CELLS_MAX: f64 = 1.6e7;
/// Cost of a step along an axis, and of one across: whole numbers add up the same in any order.
const STRAIGHT: u32 = 70;
const DIAGONAL: u32 = 99;
/// Where it is tight, a step costs so many times as much: a way goes through the middle of a door, and round a corner in
/// one bend.
const TIGHT_COST: u32 = 3;
/// Beyond the clearance, metres.
const TIGHT_M: f64 = 0.2;

/// Where a robot can stand in a world.
#[derive(Debug, Clone)]
pub(crate) struct Planner {
    low_m: [f64; 2],
    cell_m: f64,
    columns: usize,
    rows: usize,
    cells: Vec<Cell>,
}

#[derive(Debug, Clone, Copy, PartialEq, PartialOrd)]
enum Cell {
    Free,
    /// Some surface or forbidden line is not far.
    Tight,
    /// It is too near.
    Blocked,
}

impl Planner {
    /// For a robot that is to stay `clearance_m` from every surface, and from lines that it must not cross; `places` are
    /// within reach of the plan too.
    pub(crate) fn new(world: &World, clearance_m: f64, places: &[[f64; 2]]) -> Self {
        let [mut low_m, mut high_m] = world.bounds_m();
        for place in places {
            for axis in 0..2 {
                low_m[axis] = low_m[axis].min(place[axis]);
                high_m[axis] = high_m[axis].max(place[axis]);
            }
        }
        let room_m = 2.0 * clearance_m + 0.5;
        let size = |axis: usize| high_m[axis] - low_m[axis] + 2.0 * room_m;
        let cell_m = CELL_M.max((size(0) * size(1) / CELLS_MAX).sqrt()).max(size(0).max(size(1)) / CELLS_MAX);
        let (columns, rows) = ((size(0) / cell_m) as usize + 1, (size(1) / cell_m) as usize + 1);
        let low_m = [low_m[0] - room_m, low_m[1] - room_m];
        let mut planner = Self { low_m, cell_m, columns, rows, cells: vec![Cell::Free; columns * rows] };
        // A free cell keeps its distance in all of it.
        let reach_m = clearance_m + 0.7072 * cell_m;
        let forbidden = &world.parts().places.forbidden;
        for line in world.lines().chain(forbidden.iter().copied()) {
            planner.block(line.from, line.to, reach_m);
        }
        for point in world.points() {
            planner.block(point, point, reach_m + world.parts().point_radius_m);
        }
        if let Some(solid) = &world.parts().solid {
            for point in solid.samples(cell_m) {
                planner.block(point, point, 0.0);
            }
        }
        planner
    }

    /// Every cell that comes as near to a line as `reach_m`.
    fn block(&mut self, from: [f64; 2], to: [f64; 2], reach_m: f64) {
        let along = [to[0] - from[0], to[1] - from[1]];
        let length_m = libm::hypot(along[0], along[1]);
        let steps = (length_m / self.cell_m).ceil().max(1.0);
        // Discs so close together cover all between them but for less than a twentieth of a cell.
        let reach = reach_m / self.cell_m + 0.05;
        let tight = reach + TIGHT_M / self.cell_m;
        let span = tight.ceil() as i64 + 1;
        for step in 0..=(steps as usize) {
            let part = step as f64 / steps;
            let [x, y] = self.scaled([from[0] + part * along[0], from[1] + part * along[1]]);
            for row in (y.floor() as i64 - span)..=(y.floor() as i64 + span) {
                for column in (x.floor() as i64 - span)..=(x.floor() as i64 + span) {
                    let (dx, dy) = (column as f64 + 0.5 - x, row as f64 + 0.5 - y);
                    let square = dx * dx + dy * dy;
                    let Some(index) = self.index(column, row).filter(|_| square <= tight * tight) else { continue };
                    let cell = if square <= reach * reach { Cell::Blocked } else { Cell::Tight };
                    if cell > self.cells[index] {
                        self.cells[index] = cell;
                    }
                }
            }
        }
    }

    fn scaled(&self, place: [f64; 2]) -> [f64; 2] {
        [(place[0] - self.low_m[0]) / self.cell_m, (place[1] - self.low_m[1]) / self.cell_m]
    }

    fn index(&self, column: i64, row: i64) -> Option<usize> {
        let inside = column >= 0 && row >= 0 && (column as usize) < self.columns && (row as usize) < self.rows;
        inside.then(|| row as usize * self.columns + column as usize)
    }

    fn cell(&self, place: [f64; 2]) -> Option<usize> {
        let [x, y] = self.scaled(place);
        if x.is_finite() && y.is_finite() { self.index(x.floor() as i64, y.floor() as i64) } else { None }
    }

    fn is_blocked(&self, index: usize) -> bool {
        self.cells[index] == Cell::Blocked
    }

    fn is_free(&self, place: [f64; 2]) -> bool {
        self.cell(place).is_some_and(|index| !self.is_blocked(index))
    }

    fn centre(&self, index: usize) -> [f64; 2] {
        let (column, row) = (index % self.columns, index / self.columns);
        [self.low_m[0] + (column as f64 + 0.5) * self.cell_m, self.low_m[1] + (row as f64 + 0.5) * self.cell_m]
    }

    /// The way from one place to another: its corners and its end; none if there is none. A start that is too near
    /// something may leave it: bumps and people push a robot about.
    pub(crate) fn way(&self, from: [f64; 2], to: [f64; 2]) -> Option<Vec<[f64; 2]>> {
        let (start, goal) = (self.cell(from)?, self.cell(to)?);
        if self.is_blocked(goal) {
            return None;
        }
        let left = if self.is_blocked(start) { self.nearest_free(start)? } else { start };
        let cells = self.shortest(left, goal)?;
        let mut corners: Vec<[f64; 2]> = cells.into_iter().map(|cell| self.centre(cell)).collect();
        let mut way = Vec::new();
        match corners.first_mut() {
            Some(first) if left == start => *first = from,
            Some(first) => way.push(*first),
            None => {}
        }
        match corners.last_mut() {
            Some(last) if left != goal => *last = to,
            _ => way.push(to),
        }
        let mut at = 0;
        while at + 1 < corners.len() {
            // As far as one can go straight on.
            let straight = |next: &usize| self.is_straight(corners[at], corners[*next]);
            at = (at + 2..corners.len()).take_while(straight).last().unwrap_or(at + 1);
            way.push(corners[at]);
        }
        Some(way)
    }

    /// Whether nothing is too near the straight line between two places.
    fn is_straight(&self, from: [f64; 2], to: [f64; 2]) -> bool {
        let along = [to[0] - from[0], to[1] - from[1]];
        let steps = (libm::hypot(along[0], along[1]) / (0.25 * self.cell_m)).ceil().max(1.0);
        (0..=steps as usize).all(|step| {
            let part = step as f64 / steps;
            self.is_free([from[0] + part * along[0], from[1] + part * along[1]])
        })
    }

    /// Within half a metre or so.
    fn nearest_free(&self, start: usize) -> Option<usize> {
        let (column, row) = ((start % self.columns) as i64, (start / self.columns) as i64);
        let around = (-10..=10_i64).flat_map(|dy| (-10..=10_i64).map(move |dx| (dx * dx + dy * dy, dx, dy)));
        let free = around.filter_map(|(distance, dx, dy)| {
            let index = self.index(column + dx, row + dy)?;
            (!self.is_blocked(index)).then_some((distance, index))
        });
        free.min().map(|(_, index)| index)
    }

    /// A* from cell to cell.
    fn shortest(&self, start: usize, goal: usize) -> Option<Vec<usize>> {
        const NEIGHBOURS: [(i64, i64, u32); 8] = [
            (1, 0, STRAIGHT),
            (0, 1, STRAIGHT),
            (-1, 0, STRAIGHT),
            (0, -1, STRAIGHT),
            (1, 1, DIAGONAL),
            (-1, 1, DIAGONAL),
            (-1, -1, DIAGONAL),
            (1, -1, DIAGONAL),
        ];
        let place = |index: usize| ((index % self.columns) as i64, (index / self.columns) as i64);
        let (goal_column, goal_row) = place(goal);
        let at_least = |(column, row): (i64, i64)| {
            let (dx, dy) = (column.abs_diff(goal_column) as u32, row.abs_diff(goal_row) as u32);
            STRAIGHT * dx.abs_diff(dy) + DIAGONAL * dx.min(dy)
        };
        let mut cost = vec![u32::MAX; self.cells.len()];
        let mut came_by = vec![u8::MAX; self.cells.len()];
        let mut open = BinaryHeap::new();
        cost[start] = 0;
        open.push(Reverse((at_least(place(start)), start)));
        while let Some(Reverse((estimate, index))) = open.pop() {
            if index == goal {
                break;
            }
            let here = place(index);
            if estimate > cost[index].saturating_add(at_least(here)) {
                continue;
            }
            for (number, (dx, dy, step)) in (0u8..).zip(NEIGHBOURS) {
                let there = (here.0 + dx, here.1 + dy);
                let Some(next) = self.index(there.0, there.1) else { continue };
                let factor = if self.cells[next] == Cell::Tight { TIGHT_COST } else { 1 };
                let through = cost[index].saturating_add(step * factor);
                if !self.is_blocked(next) && through < cost[next] {
                    cost[next] = through;
                    came_by[next] = number;
                    open.push(Reverse((through.saturating_add(at_least(there)), next)));
                }
            }
        }
        if cost[goal] == u32::MAX {
            return None;
        }
        let mut cells = vec![goal];
        let mut at = goal;
        while at != start {
            let (dx, dy, _) = NEIGHBOURS[usize::from(came_by[at])];
            let (column, row) = place(at);
            at = self.index(column - dx, row - dy)?;
            cells.push(at);
        }
        cells.reverse();
        Some(cells)
    }
}

#[cfg(test)]
mod tests {
    use echogrid_core::world::{Places, WorldParts};
    use echogrid_core::{Segment, World};
    use proptest::prelude::*;

    use super::*;

    fn line(x1: f64, y1: f64, x2: f64, y2: f64) -> Segment {
        Segment { from: [x1, y1], to: [x2, y2] }
    }

    /// A room of 8 × 4 m with a wall across it that leaves a gap at its upper end.
    fn halves(gap_m: f64, forbidden: Vec<Segment>) -> World {
        let walls = vec![
            line(0.0, 0.0, 8.0, 0.0),
            line(8.0, 0.0, 8.0, 4.0),
            line(8.0, 4.0, 0.0, 4.0),
            line(0.0, 4.0, 0.0, 0.0),
            line(4.0, 0.0, 4.0, 4.0 - gap_m),
        ];
        World::new(WorldParts { walls, places: Places { forbidden, ..Places::default() }, ..WorldParts::default() })
            .unwrap()
    }

    /// The least distance from any wall along a way.
    fn least_clearance_m(world: &World, from: [f64; 2], way: &[[f64; 2]]) -> f64 {
        let mut least = f64::INFINITY;
        let mut here = from;
        for next in way {
            for step in 0..=1000 {
                let part = f64::from(step) / 1000.0;
                let place = [here[0] + part * (next[0] - here[0]), here[1] + part * (next[1] - here[1])];
                least = least.min(world.clearance_m(place, 9.0));
            }
            here = *next;
        }
        least
    }

    #[test]
    fn round_the_wall_and_through_the_gap() {
        let world = halves(1.2, Vec::new());
        let planner = Planner::new(&world, 0.45, &[]);
        let way = planner.way([2.0, 1.0], [6.0, 1.0]).unwrap();
        assert_eq!(way.last(), Some(&[6.0, 1.0]));
        assert!(least_clearance_m(&world, [2.0, 1.0], &way) >= 0.45, "{way:?}");
        assert!((2..=5).contains(&way.len()), "straight from corner to corner: {way:?}");
        assert_eq!(planner.way([2.0, 1.0], [2.5, 3.0]), Some(vec![[2.5, 3.0]]), "nothing is in the way");
    }

    #[test]
    fn where_there_is_no_way() {
        assert_eq!(Planner::new(&halves(0.8, Vec::new()), 0.45, &[]).way([2.0, 1.0], [6.0, 1.0]), None);
        assert_eq!(Planner::new(&halves(1.2, Vec::new()), 0.45, &[]).way([2.0, 1.0], [7.9, 1.0]), None);
        let barred = halves(1.2, vec![line(4.0, 2.0, 4.0, 4.0)]);
        assert_eq!(Planner::new(&barred, 0.45, &[]).way([2.0, 1.0], [6.0, 1.0]), None);
    }

    proptest! {
        #[test]
        fn every_way_keeps_its_distance(x in 0.6..7.4f64, y in 0.6..3.4f64, to_x in 0.6..7.4f64, to_y in 0.6..3.4f64) {
            let world = halves(1.3, Vec::new());
            prop_assume!(world.clearance_m([x, y], 1.0) > 0.55 && world.clearance_m([to_x, to_y], 1.0) > 0.55);
            let way = Planner::new(&world, 0.45, &[]).way([x, y], [to_x, to_y]).unwrap();
            prop_assert!(least_clearance_m(&world, [x, y], &way) >= 0.45 - 0.01, "{:?}", way);
        }
    }
}
