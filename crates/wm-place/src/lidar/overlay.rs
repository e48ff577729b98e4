//! Points of a sweep in pictures of the place that it was made in, hidden where the picture shows
//! something nearer.

use super::colors::PointColors;
use glam::{DMat4, DVec3, IVec2};
use wm_render::Frame;
use wm_scene::Camera;
use wm_sensors::{LidarSweep, PointFrame};

/// Share of its distance, and metres, that a point may lie behind what a pixel shows. Splats are
/// thick, and a pixel of level ground that is far away covers much of it: of the points that a
/// camera in the sensor's place sees, 1 % are hidden with these.
const HIDDEN_TOLERANCE: [f64; 2] = [0.1, 0.2];
/// Height of pictures from which on points are a pixel wider, px.
const WIDE_POINT_HEIGHT_PX: u32 = 480;
/// Largest width of a point, px.
const MAX_POINT_WIDTH_PX: u32 = 3;
/// Half of the length of the cross at the sensor, widths of a point.
const CROSS_HALF_LENGTH: i32 = 4;
const CROSS_COLOR: [u8; 3] = [255; 3];

/// Points of a sweep with their colours, to be drawn into pictures from any camera.
#[derive(Clone, Debug)]
pub struct PointOverlay {
    /// Metres, in the axes of the sweep.
    points: Vec<[f32; 3]>,
    colors: Vec<[u8; 3]>,
    world_from_points: DMat4,
    /// World axes, scene units.
    sensor: DVec3,
    metres_per_unit: f64,
}

impl PointOverlay {
    /// Colours the points of a sweep. Those of [`PointFrame::Raw`] are where they would be if the
    /// sensor had stayed.
    #[must_use]
    pub fn of(sweep: &LidarSweep, colors: PointColors) -> Self {
        let scale = DMat4::from_scale(DVec3::splat(1.0 / sweep.metres_per_unit));
        let world_from_points = match sweep.frame {
            PointFrame::World => scale,
            PointFrame::Compensated | PointFrame::Raw => {
                let pose = DMat4::from_mat3(sweep.pose.world_from_sensor);
                DMat4::from_translation(sweep.pose.origin) * pose * scale
            }
        };
        Self {
            points: sweep.points.iter().map(|point| point.position).collect(),
            colors: colors.of(sweep),
            world_from_points,
            sensor: sweep.pose.origin,
            metres_per_unit: sweep.metres_per_unit,
        }
    }

    /// Turns the colours of the points grey, for pictures that show another instant or weather.
    #[must_use]
    pub fn greyed(mut self) -> Self {
        for color in &mut self.colors {
            let [red, green, blue] = color.map(u32::from);
            *color = [(70 + (2 * red + 5 * green + blue) / 16) as u8; 3];
        }
        self
    }

    /// Draws the points and a cross at the sensor over a picture `[H, W, 3]` of `frame`'s size,
    /// which `camera` has made; the nearest is in front. A point is hidden where the expected and
    /// the median depth of all pixels next to it are nearer, as far as `frame` has these. Points
    /// are squares of 1 to 3 px by the height of the picture.
    ///
    /// # Panics
    /// If `rgb` is not of the frame's size.
    pub fn draw(&self, rgb: &mut [u8], frame: &Frame, camera: &Camera) {
        let pixels = frame.width as usize * frame.height as usize;
        assert_eq!(rgb.len(), 3 * pixels, "the picture must be of the frame's size");
        let width = (1 + frame.height / WIDE_POINT_HEIGHT_PX).min(MAX_POINT_WIDTH_PX) as i32;
        let mut canvas = Canvas { rgb, nearest: vec![f32::INFINITY; pixels], frame };
        let slack = HIDDEN_TOLERANCE[1] / self.metres_per_unit;
        let view_from_points = camera.viewmat * self.world_from_points;
        let seen = |view: DVec3| -> Option<(IVec2, f32)> {
            if view.z <= camera.near {
                return None;
            }
            let (x, y) = (camera.fx * view.x / view.z + camera.cx, camera.fy * view.y / view.z + camera.cy);
            let is_inside =
                (0.0..f64::from(frame.width)).contains(&x) && (0.0..f64::from(frame.height)).contains(&y);
            let pixel = is_inside.then(|| IVec2::new(x as i32, y as i32))?;
            let reach = depth_around(frame, pixel) * (1.0 + HIDDEN_TOLERANCE[0]) + slack;
            (view.z <= reach).then_some((pixel, view.z as f32))
        };
        for (point, color) in self.points.iter().zip(&self.colors) {
            let point = DVec3::from_array(point.map(f64::from));
            if let Some((pixel, depth)) = seen(view_from_points.transform_point3(point)) {
                canvas.square(pixel, width, depth, *color);
            }
        }
        if let Some((pixel, _)) = seen(camera.viewmat.transform_point3(self.sensor)) {
            for step in -CROSS_HALF_LENGTH * width..=CROSS_HALF_LENGTH * width {
                canvas.square(pixel + IVec2::new(step, 0), width, 0.0, CROSS_COLOR);
                canvas.square(pixel + IVec2::new(0, step), width, 0.0, CROSS_COLOR);
            }
        }
    }
}

/// The farthest depth in a pixel and those next to it, scene units; infinite where one of them
/// shows nothing.
fn depth_around(frame: &Frame, at: IVec2) -> f64 {
    let size = IVec2::new(frame.width as i32, frame.height as i32);
    let (first, last) = ((at - 1).max(IVec2::ZERO), (at + 1).min(size - 1));
    let mut farthest = 0.0_f32;
    for y in first.y..=last.y {
        for x in first.x..=last.x {
            let pixel = (y * size.x + x) as usize;
            let [mean, median] = [&frame.depth, &frame.median_depth].map(|depth| depth.get(pixel).copied());
            let depth = match (mean, median) {
                (None, None) => f32::INFINITY,
                // Less than half of the pixel is covered, or nothing.
                (_, Some(0.0)) | (Some(0.0), _) => f32::INFINITY,
                (mean, median) => mean.unwrap_or(0.0).max(median.unwrap_or(0.0)),
            };
            farthest = farthest.max(depth);
        }
    }
    f64::from(farthest)
}

/// A picture with the depths of what was drawn into it.
struct Canvas<'a> {
    rgb: &'a mut [u8],
    /// `[H, W]`, scene units.
    nearest: Vec<f32>,
    frame: &'a Frame,
}

impl Canvas<'_> {
    /// Draws a square around a pixel where nothing nearer was drawn.
    fn square(&mut self, middle: IVec2, width: i32, depth: f32, color: [u8; 3]) {
        let size = IVec2::new(self.frame.width as i32, self.frame.height as i32);
        let first = middle - width / 2;
        let (from, to) = (first.max(IVec2::ZERO), (first + width).min(size));
        for y in from.y..to.y {
            for x in from.x..to.x {
                let pixel = (y * size.x + x) as usize;
                if depth < self.nearest[pixel] {
                    self.nearest[pixel] = depth;
                    self.rgb[3 * pixel..3 * pixel + 3].copy_from_slice(&color);
                }
            }
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use glam::DMat3;
    use wm_sensors::{EchoClass, LidarPoint, ReturnRank, SensorPose};

    const FAR_COLOR: [u8; 3] = [130, 230, 255];
    const NEAR_COLOR: [u8; 3] = [190, 150, 255];

    /// A sweep from the origin, whose axes are those of the scene, of 2 m a unit.
    fn sweep(points: &[([f32; 3], EchoClass)]) -> LidarSweep {
        let point = |(position, class): &([f32; 3], EchoClass)| LidarPoint {
            position: *position,
            range: 10.0,
            intensity: 100.0,
            time: 0.0,
            angles: [0.0; 2],
            ring: 0,
            column: 0,
            rank: ReturnRank::Strongest,
            class: *class,
            label: 0,
        };
        LidarSweep {
            name: "test".into(),
            time: [0.0, 0.1],
            pose: SensorPose { origin: DVec3::new(0.0, 0.0, -1.0), world_from_sensor: DMat3::IDENTITY },
            metres_per_unit: 2.0,
            frame: PointFrame::Compensated,
            origin: DVec3::ZERO,
            pulses: points.len(),
            grid: None,
            points: points.iter().map(point).collect(),
        }
    }

    /// A camera at the origin that looks along z, 30x20 px.
    fn camera() -> Camera {
        Camera::posed((30, 20), 60.0, DVec3::ZERO, DMat3::IDENTITY)
    }

    fn frame(depth: f32) -> Frame {
        Frame {
            width: 30,
            height: 20,
            depth: vec![depth; 600],
            median_depth: vec![depth; 600],
            ..Frame::default()
        }
    }

    /// The pixels that are not black, with their colours.
    fn drawn(overlay: &PointOverlay, frame: &Frame) -> Vec<(usize, [u8; 3])> {
        let mut rgb = vec![0; 1800];
        overlay.draw(&mut rgb, frame, &camera());
        let pixels = rgb.chunks_exact(3).map(|rgb| [rgb[0], rgb[1], rgb[2]]).enumerate();
        pixels.filter(|(_, rgb)| *rgb != [0; 3]).collect()
    }

    #[test]
    fn points_are_hidden_by_what_is_nearer() {
        // 22 m ahead of the sensor: 10 units ahead of the camera.
        let overlay = PointOverlay::of(&sweep(&[([0.0, 0.0, 22.0], EchoClass::Drop)]), PointColors::Class);
        let middle = vec![(10 * 30 + 15, FAR_COLOR)];
        // The tolerance is a tenth of the depth and 0.1 units.
        for (depth, is_seen) in [(5.0, false), (8.9, false), (9.1, true), (20.0, true), (0.0, true)] {
            assert_eq!(drawn(&overlay, &frame(depth)) == middle, is_seen, "{depth}");
            assert_eq!(drawn(&overlay, &frame(depth)).is_empty(), !is_seen, "{depth}");
        }
        // One of the depths is enough to see it, and that of a pixel beside it.
        let mut mixed = frame(5.0);
        mixed.median_depth.fill(10.0);
        assert_eq!(drawn(&overlay, &mixed), middle);
        let mut edge = frame(5.0);
        (edge.depth[9 * 30 + 14], edge.median_depth[9 * 30 + 14]) = (10.0, 10.0);
        assert_eq!(drawn(&overlay, &edge), middle);
        // A picture without depths hides nothing.
        let flat = Frame { width: 30, height: 20, ..Frame::default() };
        assert_eq!(drawn(&overlay, &flat), middle);
    }

    #[test]
    fn the_nearest_point_is_in_front_and_what_is_not_in_the_picture_is_left_out() {
        let points = [
            ([0.0, 0.0, 6.0], EchoClass::Air),
            ([0.0, 0.0, 22.0], EchoClass::Drop),
            ([0.0, 0.0, -8.0], EchoClass::Drop),
            ([500.0, 0.0, 22.0], EchoClass::Drop),
            ([0.0, -500.0, 22.0], EchoClass::Drop),
        ];
        let overlay = PointOverlay::of(&sweep(&points), PointColors::Class);
        assert_eq!(drawn(&overlay, &frame(50.0)), vec![(10 * 30 + 15, NEAR_COLOR)]);
        let grey = drawn(&overlay.greyed(), &frame(50.0))[0].1;
        assert!(grey[0] == grey[1] && grey[1] == grey[2] && grey[0] > 100, "{grey:?}");
    }

    #[test]
    fn points_of_all_frames_are_in_one_place_and_the_sensor_is_a_cross() {
        let mut own = sweep(&[([4.0, 1.0, 24.0], EchoClass::Drop)]);
        own.pose.origin = DVec3::new(-1.0, 0.5, 2.0);
        let mut world = own.clone();
        world.frame = PointFrame::World;
        world.points[0].position = [2.0, 2.0, 28.0];
        let [own, world] =
            [own, world].map(|sweep| drawn(&PointOverlay::of(&sweep, PointColors::Class), &frame(50.0)));
        assert_eq!(own, world);
        assert_eq!(own.iter().filter(|(_, rgb)| *rgb == FAR_COLOR).count(), 1);
        assert_eq!(
            own.iter().filter(|(_, rgb)| *rgb == CROSS_COLOR).count(),
            4 * CROSS_HALF_LENGTH as usize + 1
        );
    }
}
