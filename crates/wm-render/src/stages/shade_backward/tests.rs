use super::cpu::{ShadeGradients, shade_backward_group};
use crate::dispatch;
use crate::hooks::GROUP;
use crate::reference::backward::basis_slopes;
use crate::testing::{Backend, uniform};
use wm_scene::sh;

crate::cpu_parity! {
    gradients_agree_in_every_degree => check;
}

fn check(backend: Backend) {
    let path = backend.path();
    for degree in 0..=3 {
        let count = sh::coefficients(degree);
        let u =
            |k: usize, lane: usize| uniform(3 + u64::from(degree), (64 * k + lane) as u64) as f32 * 2.0 - 1.0;
        let rows: Vec<[f32; GROUP]> = (0..3 * count).map(|k| std::array::from_fn(|l| u(k, l))).collect();
        let by_rgb: [[f32; GROUP]; 3] = std::array::from_fn(|k| std::array::from_fn(|l| u(50 + k, l)));
        let mut directions = [[0.0; GROUP]; 3];
        for lane in 0..GROUP {
            let d = glam::Vec3::new(u(60, lane), u(61, lane), u(62, lane)).normalize();
            (0..3).for_each(|k| directions[k][lane] = d[k]);
        }
        let mut out = ShadeGradients::default();
        dispatch!(path, s => shade_backward_group(s, &rows, &directions, &by_rgb, &mut out));
        for lane in 0..GROUP {
            let d = [0, 1, 2].map(|k| f64::from(directions[k][lane]));
            let (basis, slopes) = (sh::basis(d), basis_slopes(d));
            let mut by_direction = [0.0; 3];
            for k in 0..count {
                for c in 0..3 {
                    let by = f64::from(by_rgb[c][lane]);
                    let got = f64::from(out.sh[3 * k + c][lane]);
                    assert!((got - basis[k] * by).abs() < 2e-6, "{k}: {got}, want {}", basis[k] * by);
                    for axis in 0..3 {
                        by_direction[axis] += slopes[k][axis] * f64::from(rows[3 * k + c][lane]) * by;
                    }
                }
            }
            for axis in 0..3 {
                let got = f64::from(out.direction[axis][lane]);
                assert!((got - by_direction[axis]).abs() < 2e-5, "{got}, want {}", by_direction[axis]);
            }
        }
    }
}
