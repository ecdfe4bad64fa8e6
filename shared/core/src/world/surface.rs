//! What a ray can end at.

/// A straight line between two points, metres in the map frame.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Segment {
    /// One end of the line, metres.
    pub from: [f64; 2],
    /// The other end of the line, metres.
    pub to: [f64; 2],
}

/// A wall, or a thing too small for one.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) enum Surface {
    Wall(Segment),
    Point { centre: [f64; 2], radius_m: f64 },
}

/// A surface with a place as the origin.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) enum Seen {
    Wall { from: [f64; 2], to: [f64; 2] },
    Point { to_centre: [f64; 2], radius_m: f64 },
}

pub(super) fn dot(a: [f64; 2], b: [f64; 2]) -> f64 {
    a[0] * b[0] + a[1] * b[1]
}

pub(super) fn cross(a: [f64; 2], b: [f64; 2]) -> f64 {
    a[0] * b[1] - a[1] * b[0]
}

fn between(from: [f64; 2], to: [f64; 2]) -> [f64; 2] {
    [to[0] - from[0], to[1] - from[1]]
}

impl Seen {
    /// How far a ray from the origin goes until it meets this; none if it misses. `direction` has length 1.
    #[inline]
    pub(super) fn distance_m(&self, direction: [f64; 2]) -> Option<f64> {
        let distance = match *self {
            Self::Wall { from, to } => {
                // On which side of the ray an end lies depends on that end alone: walls that share it stay tight.
                let (side_from, side_to) = (cross(direction, from), cross(direction, to));
                if (side_from > 0.0 && side_to > 0.0) || (side_from < 0.0 && side_to < 0.0) {
                    return None;
                }
                let (ahead_from, ahead_to) = (dot(direction, from), dot(direction, to));
                if side_from == side_to {
                    // Along the wall: its nearer end, unless the origin lies within it.
                    if (ahead_from < 0.0) == (ahead_to < 0.0) { ahead_from.min(ahead_to) } else { 0.0 }
                } else {
                    ahead_from + side_from / (side_from - side_to) * (ahead_to - ahead_from)
                }
            }
            Self::Point { to_centre, radius_m } => {
                let (ahead, aside) = (dot(direction, to_centre), cross(direction, to_centre));
                let half_chord_m2 = radius_m * radius_m - aside * aside;
                if half_chord_m2 < 0.0 {
                    return None;
                }
                let half_chord = half_chord_m2.sqrt();
                // From within the disc: at once.
                if ahead.abs() < half_chord { 0.0 } else { ahead - half_chord }
            }
        };
        (distance >= 0.0).then_some(distance)
    }

    /// How far this is from the origin, metres; 0 within a disc.
    pub(super) fn off_origin_m(&self) -> f64 {
        match *self {
            Self::Wall { from, to } => {
                let along = between(from, to);
                let part = (-dot(from, along) / dot(along, along)).clamp(0.0, 1.0);
                let foot = [from[0] + part * along[0], from[1] + part * along[1]];
                // A wall too short for its square is not a number: it is near.
                dot(foot, foot).sqrt().max(0.0)
            }
            Self::Point { to_centre, radius_m } => (dot(to_centre, to_centre).sqrt() - radius_m).max(0.0),
        }
    }

    /// Whether all of it is on the right of a line through the origin (`direction` of length 1) and farther than this.
    pub(super) fn is_right_of(&self, direction: [f64; 2], farther_m: f64) -> bool {
        match *self {
            Self::Wall { from, to } => cross(direction, from) < -farther_m && cross(direction, to) < -farther_m,
            Self::Point { to_centre, radius_m } => cross(direction, to_centre) < -farther_m - radius_m,
        }
    }
}

impl Surface {
    /// How far a ray goes until it meets this; none if it misses. `direction` has length 1.
    pub(super) fn distance_m(&self, origin: [f64; 2], direction: [f64; 2]) -> Option<f64> {
        self.seen_from(origin).distance_m(direction)
    }

    pub(super) fn seen_from(&self, origin: [f64; 2]) -> Seen {
        match self {
            Self::Wall(Segment { from, to }) => Seen::Wall { from: between(origin, *from), to: between(origin, *to) },
            Self::Point { centre, radius_m } => {
                Seen::Point { to_centre: between(origin, *centre), radius_m: *radius_m }
            }
        }
    }

    /// Of length 1, against `direction`, where a ray meets this.
    pub(super) fn normal(&self, at: [f64; 2], direction: [f64; 2]) -> [f64; 2] {
        let across = match self {
            Self::Wall(Segment { from, to }) => {
                let along = between(*from, *to);
                [-along[1], along[0]]
            }
            Self::Point { centre, .. } => between(*centre, at),
        };
        let length = dot(across, across).sqrt();
        if length == 0.0 {
            // A point without an extent answers head-on.
            return [-direction[0], -direction[1]];
        }
        let scale = if dot(across, direction) > 0.0 { -1.0 / length } else { 1.0 / length };
        // Adding 0 makes −0 into 0.
        [across[0] * scale + 0.0, across[1] * scale + 0.0]
    }

    /// How far a point is from this, metres; 0 within a disc.
    pub(super) fn off_point_m(&self, point: [f64; 2]) -> f64 {
        match self {
            Self::Wall(Segment { from, to }) => {
                let (along, there) = (between(*from, *to), between(*from, point));
                let part = (dot(there, along) / dot(along, along)).clamp(0.0, 1.0);
                let [x, y] = between([part * along[0], part * along[1]], there);
                libm::hypot(x, y)
            }
            Self::Point { centre, radius_m } => {
                let [x, y] = between(*centre, point);
                (libm::hypot(x, y) - radius_m).max(0.0)
            }
        }
    }

    /// Between a ray and the normal, radians in [0, π/2].
    pub(super) fn incidence_rad(&self, direction: [f64; 2]) -> f64 {
        match self {
            Self::Wall(Segment { from, to }) => {
                let along = between(*from, *to);
                libm::atan2(dot(direction, along).abs(), cross(direction, along).abs())
            }
            Self::Point { .. } => 0.0,
        }
    }

    /// Lowest and highest x and y.
    pub(super) fn bounds_m(&self) -> [[f64; 2]; 2] {
        match self {
            Self::Wall(Segment { from, to }) => {
                [[from[0].min(to[0]), from[1].min(to[1])], [from[0].max(to[0]), from[1].max(to[1])]]
            }
            Self::Point { centre: [x, y], radius_m } => [[x - radius_m, y - radius_m], [x + radius_m, y + radius_m]],
        }
    }
}
