//! Houses: four walls, rows of windows, a roof and what hangs on them.

use super::builder::{Builder, Frame, faces};
use super::facade::{Filling, Finish, Opening, shutters, wall};
use super::roof::Roof;
use crate::paint::PaintId;

/// The direction of the ridge.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum Ridge {
    /// Along the street: eaves to the front.
    Along,
    /// Across: a gable to the front.
    Across,
}

/// The decoration of the front.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) enum Dress {
    Plain,
    /// Stone bands between the storeys and around windows.
    Bands,
    /// Shutters of this paint.
    Shutters(PaintId),
    /// Half-timbering of this paint.
    Beams(PaintId),
}

/// A house. In its frame the front runs along x from 0 to `width` at y = 0.
#[derive(Clone, Debug)]
pub(super) struct House {
    pub(crate) width: f64,
    pub(crate) depth: f64,
    pub(crate) storeys: u32,
    /// Height of a storey, m.
    pub(crate) storey: f64,
    pub(crate) pitch: f64,
    pub(crate) ridge: Ridge,
    pub(crate) columns: u32,
    /// Column of the door; a shop front takes all other columns of the ground floor where `shop`.
    pub(crate) door: u32,
    pub(crate) shop: bool,
    pub(crate) window: Filling,
    pub(crate) dress: Dress,
    pub(crate) dormers: u32,
    pub(crate) chimneys: Vec<f64>,
    pub(crate) roof: PaintId,
    pub(crate) chimney: PaintId,
    pub(crate) finish: Finish,
}

/// Height of the ground floor above the ground, m.
const GROUND_FLOOR_HEIGHT_M: f64 = 0.30;

impl House {
    fn eaves(&self) -> f64 {
        GROUND_FLOOR_HEIGHT_M + f64::from(self.storeys) * self.storey + 0.25
    }

    /// Builds it; gives the openings of its front, for what is to be hung beside them.
    pub(super) fn build(&self, b: &mut Builder, frame: &Frame) -> Vec<Opening> {
        let (w, d, h) = (self.width, self.depth, self.eaves());
        let front = self.front_openings();
        wall(b, frame, (w, h), &front, &self.finish);
        let right = Frame::facing(frame.at(w, 0.0, 0.0), -frame.right);
        let back = Frame::facing(frame.at(w, d, 0.0), -frame.back);
        let left = Frame::facing(frame.at(0.0, d, 0.0), frame.right);
        for side in [&left, &right] {
            let openings: Vec<Opening> =
                (0..self.storeys).map(|floor| self.opening(0.5 * d - 0.5, floor, 0.95)).collect();
            wall(b, side, (d, h), &openings, &self.finish);
        }
        let rear: Vec<Opening> = (0..self.storeys)
            .flat_map(|floor| [0.25, 0.7].map(|share| self.opening(share * w - 0.5, floor, 1.0)))
            .collect();
        wall(b, &back, (w, h), &rear, &self.finish);
        // Turned down: whatever looks at it from within knows that it is inside.
        let (right, ahead) = (frame.along(w, 0.0, 0.0), frame.along(0.0, -d, 0.0));
        b.quad(frame.at(0.0, d, 0.015), right, ahead, self.finish.plinth);
        self.plinth(b, frame, &front);
        let roof = self.roof();
        let roof_frame = self.roof_frame(frame);
        roof.build(b, &roof_frame);
        roof.gables(b, &roof_frame, self.finish.wall);
        if self.ridge == Ridge::Along {
            roof.gutter(b, &roof_frame, self.finish.metal);
        } else {
            self.gable_window(b, frame);
        }
        for x in &self.chimneys {
            roof.chimney(b, &roof_frame, *x, self.chimney, self.finish.stone, self.roof);
        }
        for dormer in 0..self.dormers {
            let x = w * (f64::from(dormer) + 0.5) / f64::from(self.dormers);
            roof.dormer(b, &roof_frame, x, &self.finish);
        }
        self.step(b, frame, &front);
        self.dress(b, frame, &front);
        front
    }

    fn roof(&self) -> Roof {
        let (length, span) =
            if self.ridge == Ridge::Along { (self.width, self.depth) } else { (self.depth, self.width) };
        Roof {
            length,
            span,
            eaves: self.eaves(),
            pitch: self.pitch,
            overhang: 0.42,
            verge: 0.22,
            paint: self.roof,
            trim: self.finish.frame,
        }
    }

    fn roof_frame(&self, frame: &Frame) -> Frame {
        match self.ridge {
            Ridge::Along => *frame,
            Ridge::Across => {
                Frame { origin: frame.at(self.width, 0.0, 0.0), right: frame.back, back: -frame.right }
            }
        }
    }

    fn opening(&self, x: f64, floor: u32, width: f64) -> Opening {
        let z = GROUND_FLOOR_HEIGHT_M + f64::from(floor) * self.storey + 0.85;
        Opening { x, z, width, height: self.storey - 1.35, filling: self.window }
    }

    fn front_openings(&self) -> Vec<Opening> {
        let pitch = self.width / f64::from(self.columns);
        let size = (0.46 * pitch).clamp(0.85, 1.15);
        let mut openings = Vec::new();
        for floor in 0..self.storeys {
            for column in 0..self.columns {
                let middle = pitch * (f64::from(column) + 0.5);
                if floor > 0 || (column != self.door && !self.shop) {
                    openings.push(self.opening(middle - 0.5 * size, floor, size));
                } else if column == self.door {
                    let height = self.storey - 0.45;
                    let (x, z, filling) = (middle - 0.55, GROUND_FLOOR_HEIGHT_M, Filling::Door);
                    openings.push(Opening { x, z, width: 1.1, height, filling });
                }
            }
        }
        if self.shop {
            let (from, to) = if self.door == 0 { (pitch, self.width) } else { (0.0, self.width - pitch) };
            openings.push(Opening {
                x: from + 0.45,
                z: GROUND_FLOOR_HEIGHT_M - 0.1,
                width: to - from - 0.9,
                height: self.storey - 0.7,
                filling: Filling::Shop,
            });
        }
        openings
    }

    /// A stone foot around the house, with gaps for doors.
    fn plinth(&self, b: &mut Builder, frame: &Frame, front: &[Opening]) {
        let (w, d, z) = (self.width, self.depth, GROUND_FLOOR_HEIGHT_M + 0.12);
        let mut at = 0.0;
        let doors = front.iter().filter(|o| o.z < z).map(|o| (o.x, o.x + o.width));
        let mut spans: Vec<(f64, f64)> = doors.chain([(w, w)]).collect();
        spans.sort_by(|one, two| one.0.total_cmp(&two.0));
        let mut part = |x: f64, high: [f64; 3], faces: u8| {
            b.block(frame, [x, -0.04, 0.0], high, self.finish.plinth, faces);
        };
        for (from, to) in spans {
            part(at, [from, 0.0, z], faces::FIXED & !faces::BOTTOM);
            at = to;
        }
        part(-0.04, [0.0, d, z], faces::LEFT | faces::FRONT | faces::TOP);
        part(w, [w + 0.04, d, z], faces::RIGHT | faces::FRONT | faces::TOP);
    }

    /// Steps up to the doors.
    fn step(&self, b: &mut Builder, frame: &Frame, front: &[Opening]) {
        for door in front.iter().filter(|o| o.filling == Filling::Door) {
            let (x0, x1) = (door.x - 0.12, door.x + door.width + 0.12);
            b.block(frame, [x0, -0.34, 0.0], [x1, 0.10, 0.16], self.finish.stone, faces::STANDING);
            let top = [door.x + door.width, 0.14, GROUND_FLOOR_HEIGHT_M];
            b.block(frame, [door.x, -0.06, 0.16], top, self.finish.stone, faces::STANDING);
        }
    }

    fn gable_window(&self, b: &mut Builder, frame: &Frame) {
        let rise = 0.5 * self.width * self.pitch.to_radians().tan();
        if rise < 2.4 {
            return;
        }
        let (w, h) = (0.9, (0.36 * rise).clamp(0.8, 1.25));
        let at = frame.moved(0.5 * (self.width - w), -0.16, self.eaves() + 0.22 * rise);
        b.block(&at, [-0.09, 0.08, -0.02], [w + 0.09, 0.16, h + 0.10], self.finish.stone, faces::FIXED);
        super::facade::window(b, &at.moved(0.0, -0.06, 0.02), (w, h), Filling::Casement, &self.finish);
    }

    fn dress(&self, b: &mut Builder, frame: &Frame, front: &[Opening]) {
        let windows = || front.iter().filter(|o| matches!(o.filling, Filling::Casement | Filling::Sash));
        match self.dress {
            Dress::Plain => {}
            Dress::Bands => {
                let mut band = |low: [f64; 3], x: f64, z: f64| {
                    b.block(frame, low, [x, 0.0, z], self.finish.stone, faces::FIXED);
                };
                for floor in 1..self.storeys {
                    let z = GROUND_FLOOR_HEIGHT_M + f64::from(floor) * self.storey;
                    band([0.0, -0.045, z - 0.09], self.width, z + 0.09);
                }
                for o in front.iter().filter(|o| o.filling != Filling::Shop) {
                    let z = o.z + o.height;
                    band([o.x - 0.12, -0.03, z], o.x + o.width + 0.12, z + 0.2);
                }
                let z = self.eaves();
                band([0.0, -0.09, z - 0.20], self.width, z - 0.02);
            }
            Dress::Shutters(paint) => {
                for opening in windows() {
                    shutters(b, frame, opening, paint);
                }
            }
            Dress::Beams(paint) => self.beams(b, frame, front, paint),
        }
    }

    /// Posts, rails and braces over the front, and in its gable.
    fn beams(&self, b: &mut Builder, frame: &Frame, front: &[Opening], paint: PaintId) {
        let (w, top) = (self.width, self.eaves());
        let wide = 0.19;
        let mut beam = |low: (f64, f64), high: (f64, f64)| {
            b.block(frame, [low.0, -0.035, low.1], [high.0, 0.0, high.1], paint, faces::FIXED);
        };
        let foot = GROUND_FLOOR_HEIGHT_M + 0.12;
        let free = |x: f64, z: f64| {
            !front.iter().any(|o| x > o.x - 0.10 && x < o.x + o.width + 0.10 && z > o.z && z < o.z + o.height)
        };
        // The lower edge of the beam at the floor of a storey, and of the lowest part above it.
        let floor_beam = |floor: u32| match floor {
            _ if floor == self.storeys => top - wide,
            _ => GROUND_FLOOR_HEIGHT_M + f64::from(floor) * self.storey,
        };
        let above = |floor: u32| if floor == 0 { foot } else { floor_beam(floor) + wide };
        for floor in 1..=self.storeys {
            let z = if floor == self.storeys { floor_beam(floor) } else { foot.max(floor_beam(floor)) };
            beam((0.0, z), (w, z + wide));
        }
        let pitch = w / f64::from(self.columns);
        for floor in 0..self.storeys {
            let (z0, z1) = (above(floor), floor_beam(floor + 1));
            for post in 0..=self.columns {
                let x = (pitch * f64::from(post) - 0.5 * wide).clamp(0.0, w - wide);
                beam((x, z0), (x + wide, z1));
            }
            // A post on each side of a window, a rail at its sill and its head.
            for o in front.iter().filter(|o| o.z > z0 && o.z < z1) {
                for x in [o.x - wide + 0.02, o.x + o.width - 0.02] {
                    beam((x, z0), (x + wide, o.z - 0.06));
                    beam((x, o.z - 0.06), (x + wide, z1));
                }
            }
        }
        // Braces in the free corners of each storey, as slanted boards.
        for floor in 0..self.storeys {
            let z0 = above(floor);
            let z1 = z0 + 1.15;
            for (x0, x1) in [(0.16, 0.78), (w - 0.16, w - 0.78)] {
                if free(x1, z0 + 0.4) {
                    brace(b, frame, (x0, z1), (x1, z0), wide, paint);
                }
            }
        }
        if self.ridge == Ridge::Across {
            let slope = self.pitch.to_radians().tan();
            for x in [0.25 * w, 0.5 * w, 0.75 * w] {
                let z1 = top + x.min(w - x) * slope - 0.12;
                if (x - 0.5 * w).abs() > 0.1 {
                    b.block(frame, [x - 0.09, -0.03, top], [x + 0.09, 0.0, z1], paint, faces::FIXED);
                }
            }
            let z = top + 0.25 * w * slope;
            b.block(frame, [0.25 * w, -0.028, z], [0.75 * w, 0.0, z + 0.17], paint, faces::FIXED);
            for sign in [-1.0, 1.0] {
                let from = (0.5 * w + sign * 0.46 * w, top + 0.05);
                brace(b, frame, from, (0.5 * w + sign * 0.30 * w, top + 0.14 * w * slope), 0.16, paint);
            }
        }
    }
}

/// A slanted board on a wall between two points `(x, z)`.
fn brace(b: &mut Builder, frame: &Frame, from: (f64, f64), to: (f64, f64), wide: f64, paint: PaintId) {
    let (dx, dz) = (to.0 - from.0, to.1 - from.1);
    let along = frame.along(dx, 0.0, dz);
    let across = frame.along(wide * if dx * dz > 0.0 { -1.0 } else { 1.0 }, 0.0, 0.0);
    let face = frame.at(from.0, -0.033, from.1) - across * 0.5;
    let (u, v) = if across.cross(along).dot(frame.back) < 0.0 { (across, along) } else { (along, across) };
    b.quad(face, u, v, paint);
    let depth = frame.along(0.0, 0.033, 0.0);
    for side in [face, face + across] {
        let outward = if side == face { -across } else { across };
        let (u, v) = if along.cross(depth).dot(outward) > 0.0 { (along, depth) } else { (depth, along) };
        b.quad(side, u, v, paint);
    }
}
