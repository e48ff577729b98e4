//! Command-line values for choices of the libraries.

use clap::builder::{PossibleValue, PossibleValuesParser, TypedValueParser};
use weather_magician::video::VideoEncoder;
use wm_image::color::Dither;
use wm_scene::survey::OwnSky;

/// Returns the name of the first option that is given, of options with whether they are.
pub(crate) fn first_given<const N: usize>(options: [(bool, &'static str); N]) -> Option<&'static str> {
    options.into_iter().find(|(is_given, _)| *is_given).map(|(_, name)| name)
}

/// A word of an option, its help for `--help` ("" for none), and its value.
pub(crate) type Choice<T> = (&'static str, &'static str, T);

/// Returns the parser of an option that takes one of these words.
pub(crate) fn one_of<T: Clone + Send + Sync>(
    choices: &'static [Choice<T>],
) -> impl TypedValueParser<Value = T> {
    let possible = |(word, help, _): &Choice<T>| match *help {
        "" => PossibleValue::new(*word),
        help => PossibleValue::new(*word).help(help),
    };
    let words = PossibleValuesParser::new(choices.iter().map(possible));
    words.try_map(|word| {
        let found = choices.iter().find(|(known, ..)| *known == word);
        found.map(|(.., value)| value.clone()).ok_or("is none of the words")
    })
}

/// Quantisation of 8-bit pictures.
pub(crate) const DITHERS: &[Choice<Dither>] = &[
    ("off", "Rounds to the nearest value: smooth gradients show banding", Dither::Off),
    (
        "ordered",
        "Adds a fixed blue-noise offset per pixel and channel. No pixel is off by a whole step, the \
         mean over any 16x16 pixels is right within 0.05 of a step, and exact byte values stay the same",
        Dither::Ordered,
    ),
];

/// Treatments of a scene's own sky.
pub(crate) const SKIES: &[Choice<OwnSky>] = &[
    ("keep", "Keeps it", OwnSky::Keep),
    ("drop", "Leaves it out; the colour of fog comes from the weather", OwnSky::Drop),
    (
        "rebuild",
        "Decides anew which splats are sky: those that are far and above the horizon",
        OwnSky::Rebuild,
    ),
];

/// Returns the word of a treatment of the sky.
pub(crate) fn sky_word(sky: OwnSky) -> &'static str {
    SKIES.iter().find(|(.., known)| *known == sky).map_or("keep", |(word, ..)| word)
}

/// H.264 encoders of videos.
pub(crate) const ENCODERS: &[Choice<VideoEncoder>] = &[
    (
        "builtin",
        "OpenH264, built into this program: Constrained Baseline profile. The same frames give the same bytes",
        VideoEncoder::Builtin,
    ),
    (
        "ffmpeg",
        "The program `ffmpeg` with libx264, from PATH: High profile, files about a third the size",
        VideoEncoder::Ffmpeg,
    ),
];
