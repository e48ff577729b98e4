use super::*;
use std::{fs, path::Path};
use tempfile::{TempDir, tempdir};
use wm_capture::{self as capture, CaptureOptions};
use wm_scene::testing::data;

/// A PNG file of 8 bits.
pub(crate) fn encode_png(width: u32, height: u32, color: png::ColorType, pixels: &[u8]) -> Vec<u8> {
    let mut bytes = Vec::new();
    let mut encoder = png::Encoder::new(&mut bytes, width, height);
    encoder.set_color(color);
    encoder.set_depth(png::BitDepth::Eight);
    encoder.write_header().unwrap().write_image_data(pixels).unwrap();
    bytes
}

/// A PNG of a ramp: red grows to the right, green downwards, blue is 7.
fn write_ramp(path: &Path, width: u32, height: u32) {
    let pixels = (0..height).flat_map(|y| (0..width).map(move |x| [x as u8, y as u8, 7])).flatten().collect();
    write_png(path, width, height, png::ColorType::Rgb, pixels);
}

fn write_png(path: &Path, width: u32, height: u32, color: png::ColorType, pixels: Vec<u8>) {
    fs::create_dir_all(path.parent().unwrap()).unwrap();
    fs::write(path, encode_png(width, height, color, &pixels)).unwrap();
}

/// A data set of `names` with one camera of 40 x 30 px and photos that fit it.
fn dataset(camera: &str, names: &[&str]) -> TempDir {
    let folder = tempdir().unwrap();
    let model = folder.path().join("sparse/0");
    fs::create_dir_all(&model).unwrap();
    fs::write(model.join("cameras.txt"), format!("1 {camera}\n")).unwrap();
    let images: Vec<String> = names.iter().map(|name| format!("1 1 0 0 0 0 0 0 1 {name}\n\n")).collect();
    fs::write(model.join("images.txt"), images.concat()).unwrap();
    for name in names {
        write_ramp(&folder.path().join("images").join(name), 40, 30);
    }
    folder
}

const PINHOLE: &str = "PINHOLE 40 30 30 32 20 15";

fn open(folder: &TempDir, options: &PhotoOptions) -> Result<Photos, PhotoErrors> {
    let capture = capture::read(folder.path(), &CaptureOptions::default()).unwrap();
    Photos::open(&capture, options)
}

fn say(folder: &TempDir) -> String {
    let message = open(folder, &PhotoOptions::default()).err().unwrap().to_string();
    assert!(!message.contains('\n'), "{message}");
    message.replace(&folder.path().display().to_string(), "DIR")
}

#[test]
fn photos_are_given_with_their_cameras() {
    let folder = dataset(PINHOLE, &["a.png", "s/b.png"]);
    let photos = open(&folder, &PhotoOptions::default()).unwrap();
    assert_eq!(photos.len(), 2);
    let photo = photos.get(1, 0).unwrap();
    assert_eq!((photo.width, photo.height, photo.rgb.len()), (40, 30, 3600));
    assert_eq!(photo.pixel(11, 5), [11.0 / 255.0, 5.0 / 255.0, 7.0 / 255.0]);
    assert_eq!((photo.camera.fx, photo.camera.fy, photo.camera.cx), (30.0, 32.0, 20.0));
    let half = photos.get(1, 1).unwrap();
    assert_eq!((half.width, half.height, half.camera.fx, half.camera.cy), (20, 15, 15.0, 7.5));
    // The mean of 22, 22, 23, 23, rounded up.
    assert_eq!(half.pixel(11, 5)[0], 23.0 / 255.0);
    assert_eq!(photos.camera(1, 1), half.camera);
    assert_eq!((photos.last_level(7), photos.last_level(8), photos.last_level(100)), (2, 1, 0));
    // 30 >> 3 = 3 rows are left of 30; 6 are cut off.
    assert_eq!(photos.get(0, 3).unwrap().height, 3);
}

/// The beginning of a JPEG with this description in its EXIF.
fn jpeg_header(description: &str) -> Vec<u8> {
    let text = [description.as_bytes(), &[0]].concat();
    let mut exif = b"Exif\0\0MM\0*\0\0\0\x08\0\x01\x01\x0e\0\x02".to_vec();
    exif.extend((text.len() as u32).to_be_bytes());
    exif.extend(26_u32.to_be_bytes());
    exif.extend([0; 4]);
    exif.extend(text);
    let length = (exif.len() as u16 + 2).to_be_bytes();
    let frame = [0xff, 0xc0, 0, 11, 8, 0, 60, 0, 80, 1, 1, 0x11, 0];
    [&[0xff, 0xd8, 0xff, 0xe1], &length[..], &exif, &frame].concat()
}

#[test]
fn originals_state_place_and_time_for_photos_that_lost_them() {
    let folder = dataset(PINHOLE, &["a.png", "s/b.png", "c.png"]);
    let originals = folder.path().join("camera");
    fs::create_dir(&originals).unwrap();
    let description =
        r#"{"MAPCaptureTime":"2024_05_30_08_56_09","MAPLatitude":"55.7","MAPLongitude":"13.2"}"#;
    // Of another format and size, and without the folder of the data set's name.
    fs::write(originals.join("b.jpg"), jpeg_header(description)).unwrap();
    fs::write(originals.join("c.jpg"), "no photo").unwrap();
    let read = |originals: &Path| {
        let options = CaptureOptions { originals: Some(originals.into()), ..CaptureOptions::default() };
        capture::read(folder.path(), &options)
    };
    let photos = Photos::open(&read(&originals).unwrap(), &PhotoOptions::default()).unwrap();
    assert_eq!(photos.taken, [None, None, Some(1_717_059_369.0)]);
    let places: Vec<_> = photos.gps.iter().map(|gps| gps.map(|gps| (gps.latitude, gps.longitude))).collect();
    assert_eq!(places, [None, None, Some((55.7, 13.2))]);
    let missing = read(&folder.path().join("nowhere")).unwrap_err().to_string();
    assert!(missing.contains("nowhere"), "{missing}");
}

#[test]
fn reduced_photos_scale_their_cameras() {
    let folder = dataset("PINHOLE 160 121 120 128 80 60.5", &["a.png"]);
    let photos = open(&folder, &PhotoOptions::default()).unwrap();
    let camera = photos.get(0, 0).unwrap().camera;
    assert_eq!((camera.width, camera.fx), (40, 30.0));
    assert!((camera.fy - 128.0 * 30.0 / 121.0).abs() < 1e-12);
    for (size, expected) in [
        (PhotoSize::Divided(2.0), (20, 15)),
        (PhotoSize::Longest(10), (10, 8)),
        (PhotoSize::Longest(100), (40, 30)),
        (PhotoSize::Divided(0.1), (40, 30)),
        (PhotoSize::Divided(1e9), (1, 1)),
    ] {
        let photos = open(&folder, &PhotoOptions { size, ..PhotoOptions::default() }).unwrap();
        let photo = photos.get(0, 0).unwrap();
        assert_eq!((photo.width, photo.height), expected);
        assert_eq!(photo.camera.fx, 120.0 * f64::from(expected.0) / 160.0);
    }
    assert_eq!(PhotoSize::Divided(2.0).reduced(1200, 887), (600, 444));
}

#[test]
fn bad_photos_are_named_or_skipped() {
    let folder = dataset(PINHOLE, &["a.png", "b.png", "c.png", "d.png"]);
    let images = folder.path().join("images");
    let skip = PhotoOptions { bad: BadPhotos::Skip, check: Check::Pixels, ..PhotoOptions::default() };
    fs::remove_file(images.join("b.png")).unwrap();
    assert_eq!(
        say(&folder),
        "DIR/images/b.png: the photo is missing; --images names the folder of the photos (--skip-bad goes on without it)"
    );
    write_ramp(&images.join("c.png"), 40, 20);
    assert_eq!(
        say(&folder),
        "DIR/images/b.png: the photo is missing; --images names the folder of the photos (and 1 more of 4; --skip-bad \
         goes on without them)"
    );
    write_ramp(&images.join("b.png"), 40, 30);
    assert_eq!(
        say(&folder),
        "DIR/images/c.png: the photo is 40x20 px, its camera 40x30; give the photos that the model was made from \
         (--skip-bad goes on without it)"
    );
    fs::write(images.join("c.png"), "no photo").unwrap();
    assert!(say(&folder).starts_with("DIR/images/c.png: no JPEG or PNG: it begins with \"no photo\""));
    // Damaged behind its header: found when it is decoded, or when it is asked to be.
    let whole = fs::read(images.join("d.png")).unwrap();
    fs::write(images.join("c.png"), &whole[..whole.len() / 2]).unwrap();
    let photos = open(&folder, &PhotoOptions::default()).unwrap();
    let error = photos.get(2, 0).unwrap_err();
    assert!(matches!(error.fault, PhotoFault::Damaged(_)) && error.path.ends_with("c.png"));
    assert!(photos.get(3, 0).is_ok());
    let checked = PhotoOptions { check: Check::Pixels, ..PhotoOptions::default() };
    assert_eq!(open(&folder, &checked).err().unwrap().errors, std::slice::from_ref(&error));
    let photos = open(&folder, &skip).unwrap();
    assert_eq!((photos.len(), photos.skipped()), (3, std::slice::from_ref(&error)));
    assert_eq!((0..3).map(|index| photos.view(index)).collect::<Vec<_>>(), [0, 1, 3]);
    assert!(photos.get(2, 0).is_ok());
    for name in ["a.png", "b.png", "c.png", "d.png"] {
        fs::write(images.join(name), "").unwrap();
    }
    assert_eq!(
        open(&folder, &skip).err().unwrap().to_string().replace(&images.display().to_string(), "DIR"),
        "DIR/a.png: the file is empty; copy or export it again (so are all 4 photos)"
    );
}

#[test]
fn masks_are_read_beside_the_photos() {
    let folder = dataset(PINHOLE, &["a.png", "b.png"]);
    let half: Vec<u8> = (0..40 * 30).map(|i| if i % 40 < 20 { 0 } else { 255 }).collect();
    write_png(&folder.path().join("masks/a.png.png"), 40, 30, png::ColorType::Grayscale, half.clone());
    let photos = open(&folder, &PhotoOptions::default()).unwrap();
    assert_eq!(photos.get(0, 0).unwrap().mask.as_ref(), Some(&half));
    assert_eq!(photos.get(1, 0).unwrap().mask, None);
    let reduced = photos.get(0, 2).unwrap();
    assert_eq!(reduced.mask.as_ref().unwrap()[4..6], [0, 255]);
    // Of 0 and 1, larger than the photo, and of a name without the photo's extension.
    let large: Vec<u8> = (0..80 * 60).map(|i| u8::from(i % 80 < 40)).collect();
    write_png(&folder.path().join("masks/b.png"), 80, 60, png::ColorType::Grayscale, large);
    let photos = open(&folder, &PhotoOptions::default()).unwrap();
    let mask = photos.get(1, 0).unwrap().mask.clone().unwrap();
    assert!(mask.iter().zip(&half).all(|(a, b)| *a == 255 - b));
    write_png(&folder.path().join("masks/b.png"), 30, 40, png::ColorType::Grayscale, vec![0; 1200]);
    let photos = open(&folder, &PhotoOptions::default()).unwrap();
    let error = photos.get(1, 0).unwrap_err().to_string();
    assert!(
        error.contains("the mask is 30x40 px, the photo 40x30; make the mask as large as the photo"),
        "{error}"
    );
}

#[test]
fn transparent_parts_of_a_photo_are_left_out() {
    let folder = dataset(PINHOLE, &["a.png"]);
    let pixels = (0..1200).flat_map(|i| [1, 2, 3, if i == 5 { 0 } else { 255 }]).collect();
    write_png(&folder.path().join("images/a.png"), 40, 30, png::ColorType::Rgba, pixels);
    let mask = open(&folder, &PhotoOptions::default()).unwrap().get(0, 0).unwrap().mask.clone().unwrap();
    assert!(mask[5] == 0 && mask.iter().filter(|v| **v == 255).count() == 1199);
}

/// Adds EXIF with an orientation behind the header chunk of a PNG.
fn orient(path: &Path, orientation: u8) {
    let mut bytes = fs::read(path).unwrap();
    let mut chunk = vec![0, 0, 0, 26];
    chunk.extend(b"eXIfMM\0\x2a\0\0\0\x08\0\x01\x01\x12\0\x03\0\0\0\x01\0");
    chunk.extend([orientation, 0, 0, 0, 0, 0, 0]);
    // The decoder checks it.
    let crc = chunk[4..].iter().fold(u32::MAX, |crc, byte| {
        (0..8).fold(crc ^ u32::from(*byte), |crc, _| (crc >> 1) ^ if crc & 1 == 1 { 0xedb8_8320 } else { 0 })
    });
    chunk.extend((!crc).to_be_bytes());
    bytes.splice(33..33, chunk);
    fs::write(path, bytes).unwrap();
}

#[test]
fn photos_stand_as_their_camera_does() {
    // A model of upright photos: stored ones are turned.
    let folder = dataset("PINHOLE 30 40 30 30 15 20", &["a.png"]);
    orient(&folder.path().join("images/a.png"), 6);
    let photo = open(&folder, &PhotoOptions::default()).unwrap().get(0, 0).unwrap();
    assert_eq!((photo.width, photo.height), (30, 40));
    // A quarter turn clockwise: what was at the bottom is on the left.
    assert_eq!(photo.rgb[..3], [0, 29, 7]);
    // A model of stored photos, as COLMAP makes them: nothing is turned.
    for orientation in [3, 6] {
        let folder = dataset(PINHOLE, &["a.png"]);
        orient(&folder.path().join("images/a.png"), orientation);
        let photo = open(&folder, &PhotoOptions::default()).unwrap().get(0, 0).unwrap();
        assert_eq!((photo.width, &photo.rgb[..3]), (40, &[0, 0, 7][..]));
    }
}

#[test]
fn lenses_are_undone() {
    let folder = dataset("RADIAL 40 30 30 20 15 0.1 0.01", &["a.png"]);
    let photos = open(&folder, &PhotoOptions::default()).unwrap();
    let photo = photos.get(0, 0).unwrap();
    assert!(photo.width < 40 && photo.camera.width == photo.width && photo.camera.fx == 30.0);
    // In the middle nothing moves.
    let (x, y) = (photo.camera.cx, photo.camera.cy);
    let middle = photo.pixel(x as u32, y as u32);
    assert!((middle[0] * 255.0 - 19.5).abs() <= 1.0 && (middle[1] * 255.0 - 14.5).abs() <= 1.0, "{middle:?}");
    let folder = dataset("RADIAL 40 30 30 20 15 -2 0", &["a.png"]);
    assert!(say(&folder).contains("the distortion of its camera folds over within the photo"));
}

#[test]
fn the_cache_stays_within_its_bytes() {
    let names: Vec<String> = (0..12).map(|i| format!("{i:02}.png")).collect();
    let folder = dataset(PINHOLE, &names.iter().map(String::as_str).collect::<Vec<_>>());
    let options = PhotoOptions { cache_bytes: 4 * 3600, ..PhotoOptions::default() };
    let photos = open(&folder, &options).unwrap();
    for round in 0..3 {
        for index in 0..12 {
            photos.prefetch((index + 1) % 12, 0);
            assert_eq!(photos.get(index, 0).unwrap().rgb.len(), 3600, "{round}");
            assert!(photos.shared.cache.bytes() <= 4 * 3600);
        }
    }
    // What is asked for in the background comes without being asked for again.
    photos.prefetch(5, 1);
    while photos.shared.cache.peek((5, 1)).is_none() {
        std::thread::yield_now();
    }
}

#[test]
fn real_photos_are_opened() {
    for (name, count, size) in [("sceaux-castle", 11, (600, 444)), ("lund-street", 29, (498, 373))] {
        let Some(path) = data(&format!("photos/{name}")) else { continue };
        let capture = capture::read(&path, &CaptureOptions::default()).unwrap();
        let options =
            PhotoOptions { size: PhotoSize::Divided(2.0), check: Check::Pixels, ..PhotoOptions::default() };
        let photos = Photos::open(&capture, &options).unwrap();
        assert_eq!(photos.len(), count);
        for index in 0..photos.len() {
            let photo = photos.get(index, 0).unwrap();
            assert_eq!((photo.width, photo.height), size);
        }
        assert_eq!(photos.shared.cache.bytes(), count * (size.0 * size.1 * 3) as usize);
    }
}
