//! Scenes, their splats as views of NumPy, and their changes.

use crate::arrays::{direction, moved, numbers, shape_fault, vector, view};
use crate::camera::PyCamera;
use crate::error::{Error, Failure, Outcome, line_of};
use crate::process::{CallbackProgress, detached, device_of, on_threads};
use numpy::{PyArray1, PyArray2, PyArray3};
use pyo3::exceptions::PyValueError;
use pyo3::prelude::*;
use pyo3::types::{PyDict, PyTuple};
use std::path::{Path, PathBuf};
use std::sync::Arc;
use weather_magician::batch::scene_digest_of;
use weather_magician::formats::{DetailLevel, ReadOptions, read_scene};
use weather_magician::{CpuConfig, CropBox, LengthScale, Metadata, SceneChange};
use wm_render::AnyDifferentiable;
use wm_scene::splats::{LabelKind, logit};
use wm_scene::{Group, Splats as SceneSplats};

#[doc = docs!("Scene")]
#[pyclass(frozen, name = "Scene", module = "weather_magician")]
#[derive(Clone)]
pub(crate) struct PyScene {
    pub(crate) scene: Arc<wm_scene::Scene>,
    pub(crate) origin: Option<SceneOrigin>,
}

/// The file of a scene, and how it was read.
#[derive(Clone)]
pub(crate) struct SceneOrigin {
    pub(crate) path: PathBuf,
    repair: bool,
    level: Option<u32>,
    /// Facts that were changed after it was read.
    facts: Metadata,
}

impl PyScene {
    /// Reads a scene, with the errors of the program.
    pub(crate) fn read(path: &Path, repair: bool, level: Option<u32>) -> Outcome<Self> {
        let options = ReadOptions {
            level: level.map_or(DetailLevel::Finest, DetailLevel::Number),
            ..ReadOptions::default()
        };
        let mut scene = on_threads(|| read_scene(path, &options))??;
        if repair {
            scene = scene.repaired().0;
        } else if let Err(found) = scene.check_finite() {
            let says = format!("{}: {found}; `repair=True` leaves them out", path.display());
            return Err(Failure::Library(says));
        }
        let origin = SceneOrigin { path: path.to_owned(), repair, level, facts: Metadata::default() };
        Ok(Self { scene: Arc::new(scene), origin: Some(origin) })
    }

    /// A scene of this process.
    pub(crate) fn made(scene: wm_scene::Scene) -> Self {
        Self { scene: Arc::new(scene), origin: None }
    }
}

#[pymethods]
impl PyScene {
    #[doc = docs!("Scene.open")]
    #[staticmethod]
    #[pyo3(signature = (path, *, repair=false, level=None))]
    fn open(py: Python<'_>, path: PathBuf, repair: bool, level: Option<u32>) -> PyResult<Self> {
        detached(py, |_| Self::read(&path, repair, level))
    }

    #[doc = docs!("Scene.street")]
    #[staticmethod]
    #[pyo3(signature = (detail=1.0))]
    fn street(py: Python<'_>, detail: f64) -> PyResult<Self> {
        if !(0.05..=4.0).contains(&detail) {
            return Err(PyValueError::new_err(format!("detail {detail}: must be from 0.05 to 4")));
        }
        detached(py, |stop| {
            let street = wm_street::Street::builtin();
            let sampled = on_threads(|| street.sampling(detail).scene(&|_| !stop.is_set()))?;
            sampled.map(Self::made).ok_or(Failure::Stopped)
        })
    }

    #[doc = docs!("Scene.from_arrays")]
    #[staticmethod]
    #[pyo3(signature = (means, quats, scales, opacities, sh, *, labels=None, metres_per_unit=None, up=None, ground=None))]
    #[allow(clippy::too_many_arguments)] // As many as Python's.
    fn from_arrays(
        py: Python<'_>,
        means: &Bound<'_, PyAny>,
        quats: &Bound<'_, PyAny>,
        scales: &Bound<'_, PyAny>,
        opacities: &Bound<'_, PyAny>,
        sh: &Bound<'_, PyAny>,
        labels: Option<&Bound<'_, PyAny>>,
        metres_per_unit: Option<f64>,
        up: Option<&Bound<'_, PyAny>>,
        ground: Option<f64>,
    ) -> PyResult<Self> {
        let up = up.map(|up| direction(up, "up")).transpose()?;
        let (means, shape) = numbers::<f32>(means, "means")?;
        let [count, 3] = shape[..] else { return Err(shape_fault("means", "[N, 3]", &shape)) };
        let read = |value, name: &str, width: usize| -> PyResult<Vec<f32>> {
            let (values, shape) = numbers::<f32>(value, name)?;
            let fits = if width == 1 {
                matches!(shape[..], [n] | [n, 1] if n == count)
            } else {
                shape == [count, width]
            };
            let wanted = if width == 1 { format!("[{count}]") } else { format!("[{count}, {width}]") };
            if fits { Ok(values) } else { Err(shape_fault(name, &wanted, &shape)) }
        };
        let (quats, scales, opacities) =
            (read(quats, "quats", 4)?, read(scales, "scales", 3)?, read(opacities, "opacities", 1)?);
        let (sh, shape) = numbers::<f32>(sh, "sh")?;
        let wanted = format!("[{count}, K, 3] with K 1, 4, 9 or 16");
        let degree = match shape[..] {
            [n, k @ (1 | 4 | 9 | 16), 3] if n == count => k.isqrt() as u8 - 1,
            _ => return Err(shape_fault("sh", &wanted, &shape)),
        };
        let labels = match labels {
            None => Vec::new(),
            Some(labels) => {
                let (labels, shape) = numbers::<u16>(labels, "labels")?;
                if shape != [count] {
                    return Err(shape_fault("labels", &format!("[{count}]"), &shape));
                }
                labels
            }
        };
        if let Some(at) = scales.iter().position(|scale| !(*scale > 0.0 && scale.is_finite())) {
            return Err(PyValueError::new_err(format!(
                "scales: splat {} has one that is not above 0",
                at / 3
            )));
        }
        if let Some(at) = opacities.iter().position(|opacity| !(0.0..=1.0).contains(opacity)) {
            return Err(PyValueError::new_err(format!("opacities: that of splat {at} is not from 0 to 1")));
        }
        // The largest that is not 1, whose logit is finite.
        let most = f64::from(1.0 - f32::EPSILON);
        let opaque = |opacity: f32| logit(f64::from(opacity).clamp(1e-7, most)) as f32;
        let splats = SceneSplats {
            means: means.as_chunks().0.to_vec(),
            quats: quats.as_chunks().0.to_vec(),
            log_scales: scales.as_chunks::<3>().0.iter().map(|scales| scales.map(f32::ln)).collect(),
            logit_opacities: opacities.into_iter().map(opaque).collect(),
            sh,
            sh_degree: degree,
            groups: vec![Group::Scene; count],
            labels,
            instances: Vec::new(),
        };
        let metadata = Metadata { metres_per_unit, up, ground, ..Metadata::default() };
        if let Some(fault) = metadata.fault() {
            return Err(PyValueError::new_err(fault));
        }
        detached(py, |_| {
            splats.check_finite().map_err(|found| Failure::Library(line_of(&found)))?;
            Ok(Self::made(wm_scene::Scene { splats, metadata, ..Default::default() }))
        })
    }

    fn __len__(&self) -> usize {
        self.scene.splats.len()
    }

    fn __repr__(&self) -> String {
        let of = self.origin.as_ref().map(|origin| format!("{:?}, ", origin.path.display().to_string()));
        format!("Scene({}{} splats)", of.unwrap_or_default(), self.scene.splats.len())
    }

    fn __reduce__<'py>(&self, py: Python<'py>) -> PyResult<(Bound<'py, PyAny>, Bound<'py, PyTuple>)> {
        let package = py.import("weather_magician._native")?;
        let Some(origin) = &self.origin else {
            let bytes = detached(py, |_| {
                // JSON inside, since fields of metadata may be left out.
                serde_json::to_string(&self.scene.metadata)
                    .map_err(|error| error.to_string())
                    .and_then(|facts| {
                        postcard::to_allocvec(&(&self.scene.splats, facts)).map_err(|error| error.to_string())
                    })
                    .map_err(Failure::Library)
            })?;
            let views = self.views();
            let args = (pyo3::types::PyBytes::new(py, &bytes), views).into_pyobject(py)?;
            return Ok((package.getattr("_scene_of_bytes")?, args));
        };
        let facts = &origin.facts;
        let facts = (facts.metres_per_unit, facts.up.map(|up| up.to_array()), facts.ground);
        let digest = detached(py, |_| Ok(scene_digest_of(&origin.path)?))?;
        let args = (&origin.path, origin.repair, origin.level, digest, facts).into_pyobject(py)?;
        Ok((package.getattr("_scene_of_file")?, args))
    }

    #[doc = docs!("Scene.path")]
    #[getter]
    fn path(&self) -> Option<String> {
        self.origin.as_ref().map(|origin| origin.path.display().to_string())
    }

    #[doc = docs!("Scene.splats")]
    #[getter]
    fn splats(&self) -> PySplats {
        PySplats { scene: Arc::clone(&self.scene) }
    }

    #[doc = docs!("Scene.origin")]
    #[getter]
    fn origin(&self) -> (f64, f64, f64) {
        self.scene.metadata.origin_or_zero().into()
    }

    #[doc = docs!("Scene.metres_per_unit")]
    #[getter]
    fn metres_per_unit(&self) -> Option<f64> {
        self.scene.metadata.metres_per_unit
    }

    #[doc = docs!("Scene.up")]
    #[getter]
    fn up(&self) -> Option<(f64, f64, f64)> {
        self.scene.metadata.up.map(Into::into)
    }

    #[doc = docs!("Scene.ground")]
    #[getter]
    fn ground(&self) -> Option<f64> {
        self.scene.metadata.ground
    }

    #[doc = docs!("Scene.views")]
    #[getter]
    fn views(&self) -> Vec<(String, PyCamera)> {
        self.scene.views.iter().map(|view| (view.name.clone(), PyCamera { camera: view.camera })).collect()
    }

    #[doc = docs!("Scene.with_facts")]
    #[pyo3(signature = (*, metres_per_unit=None, up=None, ground=None))]
    fn with_facts(
        &self,
        metres_per_unit: Option<f64>,
        up: Option<&Bound<'_, PyAny>>,
        ground: Option<f64>,
    ) -> PyResult<Self> {
        let up = up.map(|up| direction(up, "up")).transpose()?;
        let given = Metadata { metres_per_unit, up, ground, ..Metadata::default() };
        if let Some(fault) = given.fault() {
            return Err(PyValueError::new_err(fault));
        }
        let mut scene = (*self.scene).clone();
        let mut origin = self.origin.clone();
        if let Some(metres) = metres_per_unit {
            scene = scene.metres_per_unit(metres);
        }
        if let Some(up) = up {
            scene = scene.up(up);
        }
        if let Some(ground) = ground {
            scene = scene.ground(ground);
        }
        if let Some(SceneOrigin { facts, .. }) = &mut origin {
            facts.metres_per_unit = metres_per_unit.or(facts.metres_per_unit);
            facts.up = up.or(facts.up);
            facts.ground = ground.or(facts.ground);
        }
        Ok(Self { scene: Arc::new(scene), origin })
    }

    #[doc = docs!("Scene.save")]
    fn save(&self, py: Python<'_>, path: PathBuf) -> PyResult<()> {
        detached(py, |_| Ok(on_threads(|| self.scene.save(&path))??))
    }

    #[doc = docs!("Scene.changed")]
    #[pyo3(signature = (*, crop=None, up=None, scale=None, sh_degree=None, max_splats=None, device="auto", threads=None, progress=None))]
    #[allow(clippy::too_many_arguments)] // As many as Python's.
    fn changed(
        &self,
        py: Python<'_>,
        crop: Option<(Bound<'_, PyAny>, Bound<'_, PyAny>)>,
        up: Option<&Bound<'_, PyAny>>,
        scale: Option<&Bound<'_, PyAny>>,
        sh_degree: Option<u8>,
        max_splats: Option<u64>,
        device: &str,
        threads: Option<usize>,
        progress: Option<Py<PyAny>>,
    ) -> PyResult<(Self, Vec<String>)> {
        let corner = |at: &Bound<'_, PyAny>| vector(at, "crop");
        let crop = crop.map(|(a, b)| PyResult::Ok(CropBox::between(corner(&a)?, corner(&b)?))).transpose()?;
        let up = up.map(|up| vector(up, "up")).transpose()?;
        let wrong = || PyValueError::new_err("scale: give a factor above 0 or \"metres\"");
        let scale = match scale {
            None => None,
            Some(scale) => Some(match (scale.extract::<f64>(), scale.extract::<String>()) {
                (Ok(factor), _) if factor > 0.0 && factor.is_finite() => LengthScale::Factor(factor),
                (_, Ok(word)) if word == "metres" => LengthScale::Metres,
                _ => return Err(wrong()),
            }),
        };
        if sh_degree.is_some_and(|degree| degree > 3) || max_splats == Some(0) {
            return Err(PyValueError::new_err("sh_degree must be 0 to 3, and max_splats 1 or more"));
        }
        let change = SceneChange { crop, up, up_now: None, scale, sh_degree, max_splats };
        detached(py, |stop| {
            let mut scene = (*self.scene).clone();
            let mut reporter = CallbackProgress::new(stop, progress.as_ref());
            let device = device_of(device)?;
            let cpu = CpuConfig { threads, ..CpuConfig::default() };
            let renderer = || {
                let made = AnyDifferentiable::new(&device, cpu, |_| {})?;
                Ok(Box::new(made) as Box<dyn wm_render::Differentiable>)
            };
            let changed = on_threads(|| change.apply(&mut scene, renderer, &mut reporter))?;
            let notes = reporter.outcome(changed)?;
            Ok((Self::made(scene), notes))
        })
    }
}

/// Opens a scene that was pickled by its path, and checks that the file is the same.
#[pyfunction]
pub(crate) fn _scene_of_file(
    py: Python<'_>,
    path: PathBuf,
    repair: bool,
    level: Option<u32>,
    digest: &str,
    facts: (Option<f64>, Option<[f64; 3]>, Option<f64>),
) -> PyResult<PyScene> {
    let (scene, found) =
        detached(py, |_| Ok((PyScene::read(&path, repair, level)?, scene_digest_of(&path)?)))?;
    if found != digest {
        return Err(Error::new_err(format!("{}: is not the file that was pickled", path.display())));
    }
    let (metres_per_unit, up, ground) = facts;
    let up = up.map(|up| up.to_vec().into_pyobject(py)).transpose()?;
    scene.with_facts(metres_per_unit, up.as_ref(), ground)
}

/// Makes a scene that was pickled by its values.
#[pyfunction]
pub(crate) fn _scene_of_bytes(bytes: &[u8], views: Vec<(String, PyRef<'_, PyCamera>)>) -> PyResult<PyScene> {
    let damaged = || Error::new_err("this pickled scene is damaged");
    let (splats, facts): (SceneSplats, String) = postcard::from_bytes(bytes).map_err(|_| damaged())?;
    let metadata: Metadata = serde_json::from_str(&facts).map_err(|_| damaged())?;
    splats.check().map_err(|error| Error::new_err(line_of(&error)))?;
    let views =
        views.into_iter().map(|(name, camera)| wm_scene::SceneView { name, camera: camera.camera }).collect();
    Ok(PyScene::made(wm_scene::Scene { splats, metadata, views, ..Default::default() }))
}

#[doc = docs!("Splats")]
#[pyclass(frozen, name = "Splats", module = "weather_magician")]
pub(crate) struct PySplats {
    scene: Arc<wm_scene::Scene>,
}

#[pymethods]
impl PySplats {
    fn __len__(&self) -> usize {
        self.scene.splats.len()
    }

    fn __repr__(&self) -> String {
        format!("Splats({}, SH degree {})", self.scene.splats.len(), self.scene.splats.sh_degree)
    }

    #[doc = docs!("Splats.sh_degree")]
    #[getter]
    fn sh_degree(&self) -> u8 {
        self.scene.splats.sh_degree
    }

    #[doc = docs!("Splats.means")]
    #[getter]
    fn means<'py>(slf: &Bound<'py, Self>) -> PyResult<Bound<'py, PyArray2<f32>>> {
        let splats = &slf.get().scene.splats;
        view(slf.clone().into_any(), splats.means.as_flattened(), (splats.len(), 3))
    }

    #[doc = docs!("Splats.quats")]
    #[getter]
    fn quats<'py>(slf: &Bound<'py, Self>) -> PyResult<Bound<'py, PyArray2<f32>>> {
        let splats = &slf.get().scene.splats;
        view(slf.clone().into_any(), splats.quats.as_flattened(), (splats.len(), 4))
    }

    #[doc = docs!("Splats.log_scales")]
    #[getter]
    fn log_scales<'py>(slf: &Bound<'py, Self>) -> PyResult<Bound<'py, PyArray2<f32>>> {
        let splats = &slf.get().scene.splats;
        view(slf.clone().into_any(), splats.log_scales.as_flattened(), (splats.len(), 3))
    }

    #[doc = docs!("Splats.logit_opacities")]
    #[getter]
    fn logit_opacities<'py>(slf: &Bound<'py, Self>) -> PyResult<Bound<'py, PyArray1<f32>>> {
        let splats = &slf.get().scene.splats;
        view(slf.clone().into_any(), &splats.logit_opacities, splats.len())
    }

    #[doc = docs!("Splats.sh")]
    #[getter]
    fn sh<'py>(slf: &Bound<'py, Self>) -> PyResult<Bound<'py, PyArray3<f32>>> {
        let splats = &slf.get().scene.splats;
        view(slf.clone().into_any(), &splats.sh, (splats.len(), splats.sh_stride() / 3, 3))
    }

    #[doc = docs!("Splats.labels")]
    #[getter]
    fn labels<'py>(slf: &Bound<'py, Self>) -> PyResult<Option<Bound<'py, PyArray1<u16>>>> {
        let names = slf.get().scene.splats.names(LabelKind::Label);
        if names.is_empty() {
            return Ok(None);
        }
        view(slf.clone().into_any(), names, names.len()).map(Some)
    }

    #[doc = docs!("Splats.activated")]
    fn activated<'py>(&self, py: Python<'py>) -> PyResult<Bound<'py, PyDict>> {
        let splats = &self.scene.splats;
        let count = splats.len();
        let (scales, opacities) = detached(py, |_| {
            let scales: Vec<f32> = splats.log_scales.as_flattened().iter().map(|log| log.exp()).collect();
            let opacities: Vec<f32> = (0..count).map(|index| splats.opacity(index) as f32).collect();
            Ok((scales, opacities))
        })?;
        let dict = PyDict::new(py);
        dict.set_item("scales", moved(py, scales, &[count, 3])?)?;
        dict.set_item("opacities", moved(py, opacities, &[count])?)?;
        Ok(dict)
    }
}
