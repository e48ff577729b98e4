//! Messages of ROS 2 as CDR, little-endian, and their definitions.
//!
//! Four bytes say how the rest is encoded; alignment counts from behind them. A string is its
//! length with the final zero, its bytes and a zero; a sequence its length and its elements; an
//! array its elements alone.
//!
//! Encoded here in 50 lines: for `cdr` or `cdr-encoding`, 2 and 4 new crates, the four messages
//! would be as many lines of structs for serde.

use crate::{CameraInfo, RigidPose};
use wm_scene::LensModel;

/// The type of a message: its name and what the definition of a message begins with, followed by
/// those it is made of.
pub(super) struct MessageType {
    /// `package/msg/Type`.
    pub(crate) name: &'static str,
    /// Definitions by name: its own first, then the nested types.
    definitions: &'static [(&'static str, &'static str)],
}

impl MessageType {
    /// The definition as `ros2msg`: parts are divided by a line of 80 `=`, and all but the first
    /// begin with their name.
    pub(super) fn schema(&self) -> String {
        let mut text = String::new();
        for (index, (name, definition)) in self.definitions.iter().enumerate() {
            if index > 0 {
                text.push_str(&"=".repeat(80));
                text.push_str(&format!("\nMSG: {name}\n"));
            }
            text.push_str(definition);
        }
        text
    }
}

const TIME: (&str, &str) = ("builtin_interfaces/Time", "int32 sec\nuint32 nanosec\n");
const HEADER: (&str, &str) = ("std_msgs/Header", "builtin_interfaces/Time stamp\nstring frame_id\n");

pub(super) const TRANSFORMS: MessageType = MessageType {
    name: "tf2_msgs/msg/TFMessage",
    definitions: &[
        ("tf2_msgs/TFMessage", "geometry_msgs/TransformStamped[] transforms\n"),
        (
            "geometry_msgs/TransformStamped",
            "std_msgs/Header header\nstring child_frame_id\ngeometry_msgs/Transform transform\n",
        ),
        ("geometry_msgs/Transform", "geometry_msgs/Vector3 translation\ngeometry_msgs/Quaternion rotation\n"),
        ("geometry_msgs/Vector3", "float64 x\nfloat64 y\nfloat64 z\n"),
        ("geometry_msgs/Quaternion", "float64 x 0\nfloat64 y 0\nfloat64 z 0\nfloat64 w 1\n"),
        HEADER,
        TIME,
    ],
};

pub(super) const PICTURE: MessageType = MessageType {
    name: "sensor_msgs/msg/CompressedImage",
    definitions: &[
        ("sensor_msgs/CompressedImage", "std_msgs/Header header\nstring format\nuint8[] data\n"),
        HEADER,
        TIME,
    ],
};

pub(super) const CAMERA: MessageType = MessageType {
    name: "sensor_msgs/msg/CameraInfo",
    definitions: &[
        (
            "sensor_msgs/CameraInfo",
            "std_msgs/Header header\nuint32 height\nuint32 width\nstring distortion_model\nfloat64[] d\nfloat64[9] k\n\
             float64[9] r\nfloat64[12] p\nuint32 binning_x\nuint32 binning_y\nsensor_msgs/RegionOfInterest roi\n",
        ),
        (
            "sensor_msgs/RegionOfInterest",
            "uint32 x_offset\nuint32 y_offset\nuint32 height\nuint32 width\nbool do_rectify\n",
        ),
        HEADER,
        TIME,
    ],
};

pub(super) const POINTS: MessageType = MessageType {
    name: "sensor_msgs/msg/PointCloud2",
    definitions: &[
        (
            "sensor_msgs/PointCloud2",
            "std_msgs/Header header\nuint32 height\nuint32 width\nsensor_msgs/PointField[] fields\nbool is_bigendian\n\
             uint32 point_step\nuint32 row_step\nuint8[] data\nbool is_dense\n",
        ),
        (
            "sensor_msgs/PointField",
            "uint8 INT8=1\nuint8 UINT8=2\nuint8 INT16=3\nuint8 UINT16=4\nuint8 INT32=5\nuint8 UINT32=6\nuint8 FLOAT32=7\n\
             uint8 FLOAT64=8\nstring name\nuint32 offset\nuint8 datatype\nuint32 count\n",
        ),
        HEADER,
        TIME,
    ],
};

/// A field of a point: its name and its kind.
pub(super) type Field = (&'static str, FieldKind);

/// The kind of a field of a point, by its number in `PointField`.
#[derive(Clone, Copy)]
pub(super) enum FieldKind {
    U8 = 2,
    U16 = 4,
    U32 = 6,
    F32 = 7,
}

impl FieldKind {
    fn size(self) -> u32 {
        match self {
            Self::U8 => 1,
            Self::U16 => 2,
            Self::U32 | Self::F32 => 4,
        }
    }
}

/// A message that is being written.
struct Message(Vec<u8>);

/// Bytes before the first that alignment counts.
const HEADER_BYTES: usize = 4;

impl Message {
    fn new() -> Self {
        Self(vec![0, 1, 0, 0])
    }

    fn align(&mut self, size: usize) {
        let length = HEADER_BYTES + (self.0.len() - HEADER_BYTES).next_multiple_of(size);
        self.0.resize(length, 0);
    }

    fn u8(&mut self, value: u8) {
        self.0.push(value);
    }

    fn u32(&mut self, value: u32) {
        self.align(4);
        self.0.extend(value.to_le_bytes());
    }

    fn f64s(&mut self, values: &[f64]) {
        for value in values {
            self.align(8);
            self.0.extend(value.to_le_bytes());
        }
    }

    fn string(&mut self, text: &str) {
        self.u32(text.len() as u32 + 1);
        self.0.extend(text.as_bytes());
        self.0.push(0);
    }

    fn bytes(&mut self, bytes: &[u8]) {
        self.u32(bytes.len() as u32);
        self.0.extend(bytes);
    }

    /// A header; `time` in nanoseconds since 1970.
    fn header(&mut self, time: i64, frame: &str) {
        // Signed, of the same bytes.
        self.u32(time.div_euclid(1_000_000_000) as i32 as u32);
        self.u32(time.rem_euclid(1_000_000_000) as u32);
        self.string(frame);
    }
}

/// A `TFMessage` of transforms `parent_from_child`: parent, child and pose.
pub(super) fn transforms(time: i64, transforms: &[(&str, &str, RigidPose)]) -> Vec<u8> {
    let mut message = Message::new();
    message.u32(transforms.len() as u32);
    for (parent, child, pose) in transforms {
        message.header(time, parent);
        message.string(child);
        message.f64s(&pose.translation.to_array());
        message.f64s(&pose.rotation.to_array());
    }
    message.0
}

/// A `CompressedImage` of a JPEG.
pub(super) fn picture(time: i64, frame: &str, jpeg: &[u8]) -> Vec<u8> {
    let mut message = Message::new();
    message.header(time, frame);
    message.string("jpeg");
    message.bytes(jpeg);
    message.0
}

/// A `CameraInfo`; the first pixel's centre is at (0, 0).
pub(super) fn camera(time: i64, frame: &str, camera: &CameraInfo) -> Vec<u8> {
    let (model, lens) = match camera.lens {
        Some(LensModel::Fisheye { radial, .. }) => ("equidistant", radial.to_vec()),
        Some(LensModel::Perspective(distortion)) => ("plumb_bob", distortion.coefficients().to_vec()),
        _ => ("plumb_bob", vec![0.0; 5]),
    };
    let ([fx, fy], [cx, cy]) = (camera.focal, camera.center.map(|center| center - 0.5));
    let mut message = Message::new();
    message.header(time, frame);
    message.u32(camera.size.1);
    message.u32(camera.size.0);
    message.string(model);
    message.u32(lens.len() as u32);
    message.f64s(&lens);
    message.f64s(&[fx, 0.0, cx, 0.0, fy, cy, 0.0, 0.0, 1.0]);
    message.f64s(&[1.0, 0.0, 0.0, 0.0, 1.0, 0.0, 0.0, 0.0, 1.0]);
    message.f64s(&[fx, 0.0, cx, 0.0, 0.0, fy, cy, 0.0, 0.0, 0.0, 1.0, 0.0]);
    // Binning and the region of interest: none, the whole picture.
    for _ in 0..6 {
        message.u32(0);
    }
    message.u8(0);
    message.0
}

/// A `PointCloud2` of one row; `data` holds the fields of each point one behind the other.
pub(super) fn points(time: i64, frame: &str, fields: &[Field], data: &[u8]) -> Vec<u8> {
    let step: u32 = fields.iter().map(|(_, kind)| kind.size()).sum();
    let mut message = Message::new();
    message.header(time, frame);
    message.u32(1);
    message.u32(data.len() as u32 / step);
    message.u32(fields.len() as u32);
    let mut offset = 0;
    for (name, kind) in fields {
        message.string(name);
        message.u32(offset);
        message.u8(*kind as u8);
        message.u32(1);
        offset += kind.size();
    }
    message.u8(0);
    message.u32(step);
    message.u32(data.len() as u32);
    message.bytes(data);
    message.u8(1);
    message.0
}

#[cfg(test)]
mod tests {
    use super::*;
    use glam::{DQuat, DVec3};

    #[test]
    fn a_transform_byte_by_byte() {
        let pose = RigidPose { rotation: DQuat::IDENTITY, translation: DVec3::new(1.0, 2.0, 3.0) };
        let bytes = transforms(1_500_000_000, &[("map", "b", pose)]);
        let mut expected = vec![0, 1, 0, 0];
        expected.extend(1u32.to_le_bytes());
        expected.extend(1i32.to_le_bytes());
        expected.extend(500_000_000u32.to_le_bytes());
        expected.extend(4u32.to_le_bytes());
        expected.extend(b"map\0");
        expected.extend(2u32.to_le_bytes());
        // Two bytes of text end at 26 behind the first four: 6 to the next multiple of 8.
        expected.extend(b"b\0");
        expected.extend([0; 6]);
        for value in [1.0f64, 2.0, 3.0, 0.0, 0.0, 0.0, 1.0] {
            expected.extend(value.to_le_bytes());
        }
        assert_eq!(bytes, expected);
    }

    #[test]
    fn lenses_have_their_models() {
        let info = |lens| {
            let info = CameraInfo { size: (4, 3), focal: [2.0, 2.5], center: [2.0, 1.5], lens };
            // Header to 14, size to 24, the model and the count of its numbers.
            camera(0, "a", &info)[4 + 24..].to_vec()
        };
        let lens = wm_scene::camera::Distortion::of([0.1, 0.2, 0.3, 0.4, 0.5]);
        let bytes = info(Some(LensModel::Perspective(lens)));
        assert_eq!(&bytes[4..14], b"plumb_bob\0");
        assert_eq!(bytes[16], 5);
        let bytes = info(Some(LensModel::Fisheye { radial: [0.1, 0.2, 0.3, 0.4], widest: 1.5 }));
        assert_eq!(&bytes[4..16], b"equidistant\0");
        assert_eq!(bytes[16], 4);
        assert_eq!(bytes[24..32], 0.1f64.to_le_bytes());
    }

    #[test]
    fn definitions_name_each_type_once() {
        for kind in [TRANSFORMS, PICTURE, CAMERA, POINTS] {
            let text = kind.schema();
            assert_eq!(text.matches("MSG: ").count(), kind.definitions.len() - 1);
            for (name, _) in &kind.definitions[1..] {
                assert!(text.contains(&format!("MSG: {name}\n")) && text.contains(name), "{name}");
            }
        }
    }
}
