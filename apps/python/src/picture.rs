//! Pictures, and their layers as arrays `[C, H, W, k]`.

use crate::arrays::moved;
use crate::camera::PyCamera;
use crate::error::{Failure, Outcome};
use crate::process::detached;
use pyo3::exceptions::{PyKeyError, PyValueError};
use pyo3::prelude::*;
use pyo3::types::{PyBytes, PyDict};
use std::path::PathBuf;
use weather_magician::PictureSize;
use weather_magician::output::{LayerFile, LayerPlacement, PictureStyle};
use weather_magician::{Layers, PictureLayer};
use wm_image::color::{Dither, quantize_rgb8};
use wm_image::png;

/// The outputs of a picture that were asked for.
#[derive(Clone, Debug)]
pub(crate) struct PictureOutputs {
    /// Bytes for display.
    rgb: bool,
    /// Linear light.
    rgb_linear: bool,
    /// The others, in the order in which they were asked for.
    pub(crate) layers: Vec<PictureLayer>,
}

impl PictureOutputs {
    /// Finds outputs by their names, which are those of `--also` with `_` for `-`.
    pub(crate) fn of(names: &[String]) -> PyResult<Self> {
        let mut outputs = Self { rgb: false, rgb_linear: false, layers: Vec::new() };
        for name in names {
            match name.as_str() {
                "rgb" => outputs.rgb = true,
                "rgb_linear" => outputs.rgb_linear = true,
                _ => {
                    let wrong = |error: String| {
                        let error = error.replace('-', "_").replace("use rgb,", "use rgb, rgb_linear,");
                        PyValueError::new_err(format!("outputs: {error}"))
                    };
                    if name.contains('.') {
                        return Err(PyValueError::new_err(format!("outputs: `{name}` is not an output")));
                    }
                    let layer: PictureLayer = name.replace('_', "-").parse().map_err(wrong)?;
                    if layer.needs_another_frame() {
                        let says = "needs another frame: use a plan with this layer, or `render --also`";
                        return Err(PyValueError::new_err(format!("outputs: {name} {says}")));
                    }
                    if !outputs.layers.contains(&layer) {
                        outputs.layers.push(layer);
                    }
                }
            }
        }
        Ok(outputs)
    }

    /// The layers to render; the colour is always one of them.
    pub(crate) fn request(&self) -> Layers {
        self.layers.iter().fold(Layers::COLOR, |layers, layer| layers | (*layer).into())
    }

    /// Memory for the outputs of `count` pictures.
    pub(crate) fn stack(&self, count: usize, width: u32, height: u32) -> Outcome<PictureStack> {
        let pixels =
            (width as usize).checked_mul(height as usize).and_then(|pixels| pixels.checked_mul(count));
        let memory = || {
            Failure::Library(format!("there is too little memory for {count} pictures of {width}x{height}"))
        };
        let pixels = pixels.ok_or_else(memory)?;
        let room = |channels: usize| -> Outcome<Vec<f32>> {
            let mut values = Vec::new();
            let length = pixels.checked_mul(channels).ok_or_else(memory)?;
            values.try_reserve_exact(length).map_err(|_| memory())?;
            Ok(values)
        };
        let mut rgb = Vec::new();
        if self.rgb {
            rgb.try_reserve_exact(pixels.checked_mul(3).ok_or_else(memory)?).map_err(|_| memory())?;
        }
        let linear = if self.rgb_linear { room(3)? } else { Vec::new() };
        let layers = self.layers.iter().filter(|layer| layer.label_kind().is_none());
        let layers = layers.map(|layer| Ok((*layer, room(layer.channels().len())?)));
        let names = self.layers.iter().filter(|layer| layer.label_kind().is_some());
        let names = names.map(|layer| (*layer, Vec::new()));
        Ok(PictureStack {
            outputs: self.clone(),
            shape: [count, height as usize, width as usize],
            rgb,
            linear,
            layers: layers.collect::<Outcome<_>>()?,
            names: names.collect(),
        })
    }
}

/// The outputs of some pictures of one size, one after the other.
pub(crate) struct PictureStack {
    outputs: PictureOutputs,
    shape: [usize; 3],
    rgb: Vec<u8>,
    linear: Vec<f32>,
    layers: Vec<(PictureLayer, Vec<f32>)>,
    names: Vec<(PictureLayer, Vec<u16>)>,
}

impl PictureStack {
    /// Adds the outputs of a picture.
    pub(crate) fn add(&mut self, picture: &weather_magician::Picture) {
        let frame = &picture.frame;
        if self.outputs.rgb {
            let size = PictureSize::new(frame.width, frame.height);
            self.rgb.append(&mut quantize_rgb8(&frame.rgb, size, Dither::default()));
        }
        if self.outputs.rgb_linear {
            self.linear.append(&mut frame.rgb_linear());
        }
        for (layer, values) in &mut self.layers {
            values.extend_from_slice(&picture.layer(*layer));
        }
        for (layer, values) in &mut self.names {
            let labels = &picture.labels;
            let names = if *layer == PictureLayer::Label { &labels.label } else { &labels.instance };
            match names.is_empty() {
                // A scene without labels.
                true => values.extend(std::iter::repeat_n(0, frame.pixels())),
                false => values.extend_from_slice(names),
            }
        }
    }

    /// Returns arrays `[C, H, W, k]` by their names.
    pub(crate) fn into_dict(self, py: Python<'_>) -> PyResult<Bound<'_, PyDict>> {
        let [count, height, width] = self.shape;
        let shape = |channels: usize| [count, height, width, channels];
        let dict = PyDict::new(py);
        if self.outputs.rgb {
            dict.set_item("rgb", moved(py, self.rgb, &shape(3))?)?;
        }
        if self.outputs.rgb_linear {
            dict.set_item("rgb_linear", moved(py, self.linear, &shape(3))?)?;
        }
        for (layer, values) in self.layers {
            let array = moved(py, values, &shape(layer.channels().len()))?;
            dict.set_item(layer.name().replace('-', "_"), array)?;
        }
        for (layer, values) in self.names {
            dict.set_item(layer.name().replace('-', "_"), moved(py, values, &shape(1))?)?;
        }
        Ok(dict)
    }
}

#[doc = docs!("Picture")]
#[pyclass(frozen, name = "Picture", module = "weather_magician")]
pub(crate) struct PyPicture {
    pub(crate) picture: weather_magician::Picture,
    pub(crate) outputs: PictureOutputs,
    pub(crate) camera: wm_scene::Camera,
}

impl PyPicture {
    fn array_of<'py>(&self, py: Python<'py>, name: &str) -> PyResult<Bound<'py, PyAny>> {
        let asked = PictureOutputs::of(&[name.to_owned()])?;
        let was_asked = asked
            .layers
            .iter()
            .all(|layer| self.outputs.layers.contains(layer) || *layer == PictureLayer::Alpha);
        if !was_asked {
            let says = format!("{name}: was not rendered; ask for it with outputs=[{name:?}]");
            return Err(PyKeyError::new_err(says));
        }
        let frame = &self.picture.frame;
        let stack = detached(py, |_| {
            let mut stack = asked.stack(1, frame.width, frame.height)?;
            stack.add(&self.picture);
            Ok(stack)
        })?;
        let channels = if name.starts_with("rgb") { 3 } else { asked.layers[0].channels().len() };
        let (height, width) = (frame.height as usize, frame.width as usize);
        let shape: Vec<usize> =
            if channels == 1 { vec![height, width] } else { vec![height, width, channels] };
        let arrays = stack.into_dict(py)?;
        let array = arrays.get_item(name)?.ok_or_else(|| PyKeyError::new_err(name.to_owned()))?;
        array.call_method1("reshape", (shape,))
    }
}

#[pymethods]
impl PyPicture {
    fn __repr__(&self) -> String {
        format!("Picture({}x{})", self.picture.frame.width, self.picture.frame.height)
    }

    #[doc = docs!("Picture.width")]
    #[getter]
    fn width(&self) -> u32 {
        self.picture.frame.width
    }

    #[doc = docs!("Picture.height")]
    #[getter]
    fn height(&self) -> u32 {
        self.picture.frame.height
    }

    #[doc = docs!("Picture.camera")]
    #[getter]
    fn camera(&self) -> PyCamera {
        PyCamera { camera: self.camera }
    }

    #[doc = docs!("Picture.tags")]
    #[getter]
    fn tags(&self) -> Vec<(String, String)> {
        self.picture.tags.clone()
    }

    fn __getitem__<'py>(&self, py: Python<'py>, name: &str) -> PyResult<Bound<'py, PyAny>> {
        self.array_of(py, name)
    }

    #[doc = docs!("Picture.rgb")]
    #[getter]
    fn rgb<'py>(&self, py: Python<'py>) -> PyResult<Bound<'py, PyAny>> {
        self.array_of(py, "rgb")
    }

    #[doc = docs!("Picture.rgb_linear")]
    #[getter]
    fn rgb_linear<'py>(&self, py: Python<'py>) -> PyResult<Bound<'py, PyAny>> {
        self.array_of(py, "rgb_linear")
    }

    #[doc = docs!("Picture.save")]
    #[pyo3(signature = (path, *, layers=false))]
    fn save(&self, py: Python<'_>, path: PathBuf, layers: bool) -> PyResult<Vec<String>> {
        detached(py, |_| {
            let style = PictureStyle {
                also: self
                    .outputs
                    .layers
                    .iter()
                    .map(|layer| LayerFile { layer: *layer, format: None })
                    .collect(),
                place: if layers { LayerPlacement::Layers } else { LayerPlacement::Beside },
                tags: self.picture.tags.clone(),
                ..PictureStyle::default()
            };
            Ok(style.write(&self.picture, &path)?)
        })
    }

    fn _repr_png_<'py>(&self, py: Python<'py>) -> PyResult<Bound<'py, PyBytes>> {
        let bytes: Vec<u8> = detached(py, |_| {
            let frame = &self.picture.frame;
            let size = PictureSize::new(frame.width, frame.height);
            let bytes = png::encode_rgb8(&quantize_rgb8(&frame.rgb, size, Dither::default()), size);
            bytes.map_err(|error| Failure::Library(error.to_string()))
        })?;
        Ok(PyBytes::new(py, &bytes))
    }
}
