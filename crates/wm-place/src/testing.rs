//! Helpers of tests.

use crate::{Camera, CpuConfig, Device, FrameCamera, PreparedPlace, Renderer};

/// A renderer on two threads of the CPU.
pub(crate) fn renderer() -> Renderer {
    Renderer::new(&Device::Cpu, CpuConfig { threads: Some(2), ..CpuConfig::default() }, |_| {}).unwrap()
}

/// The built-in street in few splats, and a camera on its drive.
pub(crate) fn street(renderer: &mut Renderer) -> (PreparedPlace, Camera) {
    let street = wm_street::Street::builtin();
    let place = renderer.load(street.sampling(0.1).scene(&|_| true).unwrap()).unwrap();
    let view = street.dolly(0.3).camera((120, 80)).unwrap();
    let look = Camera::look_at(view.center().to_array(), (view.center() + view.forward()).to_array());
    let camera = FrameCamera::from(look).at(0.0, &place).unwrap().camera;
    (place, camera)
}
