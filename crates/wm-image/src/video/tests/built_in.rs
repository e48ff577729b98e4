//! The built-in encoder, from frames to decoded planes.

use shiguredo_mp4::Either;
use shiguredo_mp4::boxes::StszBox;

use wm_base::files::WriteFault;

use super::parsed::{Parsed, vui_colour};
use super::*;
use crate::color::Dither;

#[test]
fn the_file_has_what_players_need() {
    let directory = tempfile::tempdir().unwrap();
    let path = directory.path().join("a.mp4");
    let size = PictureSize::new(150, 98);
    for (rate, timescale, delta, keyframes) in [
        ("30", 10_020, 334, vec![1, 61, 121]),
        ("23.976", 24_000, 1001, vec![1, 48, 95]),
        ("29.97", 30_000, 1001, vec![1, 60, 119]),
        ("120", 10_080, 84, vec![1]),
        ("0.5", 10_000, 20_000, (1..=130).collect()),
    ] {
        let tags = vec![("scene".to_owned(), "Straße".to_owned()), ("seed".to_owned(), "7".to_owned())];
        let settings = VideoSettings { tags, ..settings(size, rate) };
        let frames: Vec<_> = (0..10).map(|i| foggy(size, i as f32 / 10.0)).collect();
        let mut sink = create_video(&path, settings).unwrap();
        for i in 0..130 {
            sink.frame(&frames[i % 10]).unwrap();
        }
        let report = sink.finish().unwrap();
        let file = Parsed::open(&path);

        let kinds: Vec<_> = file.boxes.iter().map(|(kind, _)| kind.as_str()).collect();
        assert_eq!(kinds, ["ftyp", "moov", "mdat"], "{rate}");
        assert_eq!((report.frames, report.bytes), (130, file.bytes.len() as u64));

        let track = &file.moov.trak_boxes[0];
        let duration = 130 * u64::from(delta);
        assert_eq!(file.moov.trak_boxes.len(), 1);
        assert_eq!(track.mdia_box.mdhd_box.timescale.get(), timescale, "{rate}");
        assert_eq!(track.mdia_box.mdhd_box.duration, duration);
        assert_eq!((file.moov.mvhd_box.duration, track.tkhd_box.duration), (duration, duration));
        assert!((report.seconds - duration as f64 / f64::from(timescale)).abs() < 1e-9);

        let table = file.table();
        assert_eq!(table.stts_box.entries.len(), 1);
        let times = &table.stts_box.entries[0];
        assert_eq!((times.sample_count, times.sample_delta), (130, delta), "{rate}");
        let stss = table.stss_box.as_ref().unwrap();
        let found: Vec<u32> = stss.sample_numbers.iter().map(|number| number.get()).collect();
        assert_eq!(found, keyframes, "{rate}");

        // Sizes add up to mdat, chunks begin where the samples before them end.
        let mdat = file.boxes[2].1.clone();
        let StszBox::Variable { entry_sizes } = &table.stsz_box else { panic!("one size for all") };
        assert_eq!(entry_sizes.iter().map(|&size| size as usize).sum::<usize>(), mdat.len() - 8);
        let Either::A(offsets) = &table.stco_or_co64_box else { panic!("wide offsets") };
        assert_eq!(offsets.chunk_offsets[0] as usize, mdat.start + 8);
        let samples = file.samples();
        assert_eq!(samples.len(), 130);
        assert_eq!(samples.concat(), file.bytes[mdat.start + 8..mdat.end]);
        // Lengths lead from unit to unit; parameter sets are not among them.
        for (sample, number) in samples.iter().zip(1..) {
            let mut rest = *sample;
            while let Some((length, tail)) = rest.split_first_chunk::<4>() {
                let unit = &tail[..u32::from_be_bytes(*length) as usize];
                let keyframe = keyframes.contains(&number);
                assert_eq!(unit[0] & 31, if keyframe { 5 } else { 1 }, "{rate}, sample {number}");
                rest = &tail[unit.len()..];
            }
            assert!(rest.is_empty());
        }

        let entry = file.entry();
        assert_eq!((entry.visual.width, entry.visual.height), (150, 98));
        let config = &entry.avcc_box;
        assert_eq!((config.sps_list.len(), config.pps_list.len()), (1, 1));
        assert_eq!(config.length_size_minus_one.get(), 3);
        assert_eq!(
            config.sps_list[0][1..4],
            [config.avc_profile_indication, config.profile_compatibility, config.avc_level_indication]
        );
        assert_eq!(vui_colour(&config.sps_list[0]), [1, 0, 1, 1, 1, 1], "BT.709, limited range");
        let colr = &entry.unknown_boxes[0];
        assert_eq!(colr.box_type.as_bytes(), b"colr");
        assert_eq!(colr.payload, b"nclx\x00\x01\x00\x01\x00\x01\x00");
        let udta = &file.moov.unknown_boxes[0].payload;
        let comment = "scene = Straße\nseed = 7".as_bytes();
        assert!(udta.windows(comment.len()).any(|window| window == comment));

        if by_ffmpeg::found("ffprobe") && by_ffmpeg::found("ffmpeg") {
            let entries =
                ["codec_tag_string", "nb_read_packets", "color_range", "color_space", "color_transfer"];
            assert_eq!(by_ffmpeg::probe(&path, &entries), ["avc1", "130", "tv", "bt709", "bt709"]);
            let ours: Vec<u8> = file.decode().into_iter().flatten().flatten().collect();
            assert!(by_ffmpeg::decode(&path) == ours, "two decoders disagree");
        }
    }
    assert_eq!(fs::read_dir(&directory).unwrap().count(), 1);
}

fn psnr(a: &[u8], b: &[u8]) -> f64 {
    let sum: f64 = a.iter().zip(b).map(|(&a, &b)| (f64::from(a) - f64::from(b)).powi(2)).sum();
    10.0 * (255.0 * 255.0 * a.len() as f64 / sum.max(1e-9)).log10()
}

/// Root mean square of the error of 32x32 means of decoded luma in the sky of [`foggy`], in steps.
fn sky_error(luma: &[u8], exact: &[f32], size: PictureSize) -> f64 {
    let (width, sky) = (size.width as usize, size.height as usize * 2 / 5);
    let mut errors = Vec::new();
    for y in (0..sky - 32).step_by(4) {
        for x in (0..width - 32).step_by(4) {
            let at = |i: usize| (y + i / 32) * width + x + i % 32;
            let error: f64 = (0..1024).map(|i| f64::from(luma[at(i)]) - f64::from(exact[at(i)])).sum();
            errors.push((error / 1024.0).powi(2));
        }
    }
    (errors.iter().sum::<f64>() / errors.len() as f64).sqrt()
}

#[test]
fn fog_comes_back_close_and_without_contours() {
    let directory = tempfile::tempdir().unwrap();
    let path = directory.path().join("a.mp4");
    let size = PictureSize::new(640, 384);
    let frames: Vec<_> = (0..24).map(|i| foggy(size, i as f32 / 12.0)).collect();
    let mut sky_errors = Vec::new();
    for dither in [Dither::Off, Dither::Ordered] {
        let settings = VideoSettings { dither, ..settings(size, "12") };
        write(&path, settings, &frames);
        let decoded = Parsed::open(&path).decode();
        assert_eq!(decoded.len(), frames.len());
        let mut exact = yuv::Yuv420::new(size, Dither::Off);
        for (at, (frame, planes)) in frames.iter().zip(&decoded).enumerate() {
            exact.convert(frame);
            for (plane, exact) in planes.iter().zip(exact.planes()) {
                // 49 dB and more; 38 is what one calls good.
                let psnr = psnr(plane, exact);
                assert!(psnr > 46.0, "{psnr} dB in frame {at}");
            }
        }
        let luma: Vec<f32> = frames[23]
            .chunks(3)
            .map(|c| 16.0 + 219.0 * (0.2126 * c[0] + 0.7152 * c[1] + 0.0722 * c[2]))
            .collect();
        sky_errors.push(sky_error(&decoded[23][0], &luma, size));
    }
    println!("error of 32x32 means in the sky, rounded and dithered: {sky_errors:.3?} steps");
    // Contours one step apart have an error up to half a step, 0.29 on average, in every mean.
    assert!(sky_errors[1] < 0.12, "{sky_errors:?}");
}

#[test]
fn colours_are_bt709_in_limited_range() {
    let directory = tempfile::tempdir().unwrap();
    let path = directory.path().join("a.mp4");
    let size = PictureSize::new(64, 64);
    let colours = [
        [1.0, 0.0, 0.0],
        [0.0, 1.0, 0.0],
        [0.0, 0.0, 1.0],
        [1.0, 1.0, 1.0],
        [0.0, 0.0, 0.0],
        [0.25, 0.5, 0.75],
    ];
    let frames: Vec<_> = colours.iter().map(|colour| colour.repeat(size.pixels())).collect();
    for dither in [Dither::Off, Dither::Ordered] {
        write(&path, VideoSettings { dither, ..settings(size, "30") }, &frames);
        for (colour, planes) in colours.iter().zip(Parsed::open(&path).decode()) {
            let mut errors = [0.0; 3];
            for at in 0..size.pixels() {
                let chroma = at / 64 / 2 * 32 + at % 64 / 2;
                let [y, cb, cr] = [planes[0][at], planes[1][chroma], planes[2][chroma]].map(f64::from);
                for ((value, &expected), sum) in
                    yuv::rgb_of(y, cb, cr).into_iter().zip(colour).zip(&mut errors)
                {
                    let error = (value - f64::from(expected)) * 255.0;
                    *sum += error / size.pixels() as f64;
                    // A dithered pixel is off by up to a step in each of three planes.
                    assert!(dither == Dither::Ordered || error.abs() < 2.0, "{colour:?}: {error}/255");
                }
            }
            assert!(errors.iter().all(|error| error.abs() < 2.0), "{colour:?}: {errors:?}/255");
        }
    }
}

#[test]
fn the_same_frames_give_the_same_bytes() {
    let directory = tempfile::tempdir().unwrap();
    let size = PictureSize::new(160, 96);
    let frames: Vec<_> = (0..30).map(|i| foggy(size, i as f32 / 10.0)).collect();
    for bitrate in [None, Some(200_000)] {
        let [first, second] = ["a.mp4", "b.mp4"].map(|name| {
            let path = directory.path().join(name);
            write(&path, VideoSettings { bitrate, ..settings(size, "10") }, &frames);
            fs::read(path).unwrap()
        });
        assert!(first == second);
    }
}

#[test]
fn a_bitrate_is_kept_and_no_frame_is_lost() {
    let directory = tempfile::tempdir().unwrap();
    let path = directory.path().join("a.mp4");
    let size = PictureSize::new(320, 192);
    for rate in ["24", "120"] {
        let hz = rate.parse::<FrameRate>().unwrap().hz() as f32;
        let frames: Vec<_> = (0..96).map(|i| foggy(size, i as f32 / hz * 3.0)).collect();
        for bitrate in [150_000, 600_000] {
            let settings = VideoSettings { bitrate: Some(bitrate), ..settings(size, rate) };
            let report = write(&path, settings, &frames);
            let found = report.bytes as f64 * 8.0 / report.seconds;
            println!("{rate} fps, asked {bitrate}, got {found:.0}");
            // A second or four of video, of which a keyframe is a large part.
            assert!((0.6..1.5).contains(&(found / f64::from(bitrate))), "{bitrate}: {found}");
            assert_eq!(Parsed::open(&path).decode().len(), 96);
        }
    }
    // What cannot be kept is exceeded instead.
    let frames: Vec<_> = (0..12).map(|i| foggy(size, i as f32)).collect();
    let settings = VideoSettings { bitrate: Some(1), ..settings(size, "24") };
    assert_eq!(write(&path, settings, &frames).frames, 12);
}

#[test]
fn white_noise_at_all_sizes_is_encoded() {
    let directory = tempfile::tempdir().unwrap();
    let path = directory.path().join("a.mp4");
    for (width, height) in [(16, 16), (18, 500), (1000, 22), (642, 362)] {
        let size = PictureSize::new(width, height);
        let frames: Vec<Vec<f32>> =
            (0..4).map(|t| (0..size.pixels() * 3).map(|i| lattice(i as f32, t as f32)).collect()).collect();
        write(&path, settings(size, "30"), &frames);
        let decoded = Parsed::open(&path).decode();
        assert_eq!(decoded.len(), 4);
        assert_eq!(decoded[3][0].len(), size.pixels());
    }
    for (width, height) in [(14, 64), (3842, 64), (64, 3842), (2162, 2162)] {
        let error = create_video(&path, settings(PictureSize::new(width, height), "30")).err().unwrap();
        assert!(matches!(error, MediaError::EncoderSize { .. }), "{error}");
        assert!(!error.to_string().contains('\n'));
    }
}

#[test]
fn nothing_is_left_of_a_video_given_up() {
    let directory = tempfile::tempdir().unwrap();
    let path = directory.path().join("a.mp4");
    let size = PictureSize::new(64, 64);
    let mut sink = create_video(&path, settings(size, "30")).unwrap();
    sink.frame(&foggy(size, 0.0)).unwrap();
    drop(sink);
    assert!(is_empty(directory.path()));
    let error = create_video(&path, settings(size, "30")).unwrap().finish().unwrap_err();
    assert!(matches!(error, MediaError::NoFrames(_)), "{error}");
    assert!(is_empty(directory.path()));
    let missing = create_video(&directory.path().join("no/a.mp4"), settings(size, "30")).err().unwrap();
    assert!(matches!(missing, MediaError::Write { fault: WriteFault::NoFolder(_), .. }), "{missing}");
    // A directory that comes into the file's place meanwhile.
    let mut sink = create_video(&path, settings(size, "30")).unwrap();
    sink.frame(&foggy(size, 0.0)).unwrap();
    fs::create_dir(&path).unwrap();
    let error = sink.finish().unwrap_err();
    assert!(matches!(error, MediaError::Write { fault: WriteFault::IsFolder, .. }), "{error}");
    assert_eq!(fs::read_dir(&directory).unwrap().count(), 1);
}
