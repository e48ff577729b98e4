use super::*;
use proptest::prelude::*;
use wm_render::frame::{srgb_decode, srgb_encode};
use wm_render::testing::Backend;

wm_render::parity! {
    air_agrees_with_f64 => |backend| {
        for (i, atmosphere) in atmospheres().iter().enumerate() {
            agree(backend, atmosphere, i as u64);
        }
    };
}

/// Without any GPU, and with the constants that it is given here.
#[test]
fn the_gpus_form_is_valid() {
    for atmosphere in atmospheres() {
        let source = atmosphere.wgsl([1.0, 2.0, 3.0]).unwrap();
        wm_render::testing::check_air(&source).unwrap();
        assert_eq!(source.parameters.len(), 6 + 8 * atmosphere.layers.len());
    }
}

const SITE: Site = Site {
    origin: [0.0; 3],
    metres_per_unit: 2.5,
    up: [0.0, -0.6, 0.8],
    ground: -1.0,
    airlight: [0.6, 0.7, 0.8],
    far: 300.0,
    ..Site::PLAIN
};

fn layer(sigma: f64, scale_height: f64) -> AirLayer {
    AirLayer {
        sigma_t: [0.9 * sigma, sigma, 1.2 * sigma],
        airlight: [0.5, 0.6, 0.7],
        scale_height,
        base_height: 1.0,
    }
}

fn atmospheres() -> Vec<Atmosphere> {
    let thick = AirLayer { airlight: [0.8, 0.7, 0.4], ..layer(0.02, 60.0) };
    [
        vec![layer(0.015, f64::INFINITY)],
        vec![layer(0.015, 12.0)],
        vec![layer(6e-5, 1000.0)],
        vec![layer(0.01, f64::INFINITY), thick],
        vec![thick, layer(0.003, 400.0), layer(0.001, f64::INFINITY)],
    ]
    .map(|layers| Atmosphere::new(layers, SITE))
    .into()
}

/// f32 against f64 over distances to infinity, directions all round and near the horizon, colours
/// from 0 to 3. Tolerance: optical depth errs by 2e-6 relative, and T changes by at most that times
/// depth times T < 0.37; sRGB and back by 2e-6: in all 1e-5, a fortieth of an 8-bit step. Along an
/// endless ray through a layer the depth goes with 1 / rise, the rise is a sum of f32 that errs by
/// 1e-7, and the encoding multiplies what is dark by 12.92: 0.37 * 0.8 * 12.92 * 1e-7 / rise.
fn agree(backend: Backend, atmosphere: &Atmosphere, seed: u64) {
    let uniform = |k: u64| wm_render::testing::uniform(seed, k);
    for origin in [[0.0f32, 0.0, 0.0], [4.0, -30.0, 60.0], [1.0, 2.0, -3.0]] {
        let mut groups = [ShadeGroup::default(); 16];
        for i in 0..256 {
            let u = |k: u64| uniform(i as u64 * 8 + k) * 2.0 - 1.0;
            let mut d = [u(0), u(1), u(2)];
            if i % 4 == 0 {
                // Across up, within a ten-thousandth: where the closed form changes over.
                let along: f64 = (0..3).map(|k| d[k] * SITE.up[k]).sum();
                d = std::array::from_fn(|k| d[k] - (along - 1e-4 * u(3)) * SITE.up[k]);
            }
            let length = d.iter().map(|v| v * v).sum::<f64>().sqrt();
            let (group, lane) = (&mut groups[i / GROUP], i % GROUP);
            group.distance[lane] = if i % 7 == 0 { f32::INFINITY } else { 10f32.powf(2.5 * u(4) as f32) };
            for k in 0..3 {
                group.direction[k][lane] = (d[k] / length) as f32;
                group.rgb[k][lane] = if i % 5 == 0 { 0.0 } else { (1.5 + 1.5 * u(5 + k as u64)) as f32 };
            }
        }
        let before = groups;
        backend.shade(atmosphere, origin, &mut groups);
        for i in 0..256 {
            let (seen, group, lane) = (&groups[i / GROUP], &before[i / GROUP], i % GROUP);
            let direction = [0, 1, 2].map(|k| f64::from(group.direction[k][lane]));
            let rgb = [0, 1, 2].map(|k| f64::from(group.rgb[k][lane]));
            let distance = f64::from(group.distance[lane]);
            let want = atmosphere.reference(origin.map(f64::from), direction, distance, rgb);
            for k in 0..3 {
                let got = f64::from(seen.rgb[k][lane]);
                let rise = dot(direction, SITE.up);
                let tolerance = 1e-5 + 4e-7 / rise.abs().max(1e-7);
                assert!(
                    (got - want[k]).abs() < tolerance,
                    "{i} {distance} {direction:?}: {got}, want {}",
                    want[k]
                );
            }
        }
    }
}

/// The primitives against f64, and what shading makes of them: white less black is the
/// transmittance, up to two trips through the display's encoding.
#[test]
fn transmittance_and_airlight_agree_with_f64_and_with_colors() {
    let uniform = |k: u64| wm_base::random::uniform(9, k);
    let origin = [1.0f32, 2.0, 3.0];
    let mut rays = [ShadeGroup::default(); 16];
    for i in 0..256 {
        let d: [f64; 3] = [0, 1, 2].map(|k| uniform(i as u64 * 8 + k) * 2.0 - 1.0);
        let length = d.iter().map(|v| v * v).sum::<f64>().sqrt();
        let (group, lane) = (&mut rays[i / GROUP], i % GROUP);
        group.distance[lane] = 10f32.powf(3.0 * uniform(i as u64 * 8 + 4) as f32);
        (0..3).for_each(|k| group.direction[k][lane] = (d[k] / length) as f32);
    }
    for path in SimdPath::available() {
        for atmosphere in atmospheres() {
            let mut air = [AirGroup::default(); 16];
            atmosphere.evaluate(path, origin, &rays, &mut air);
            let mut shares = [[[0.0; GROUP]; 3]; 16];
            atmosphere.transmittance(path, origin, &rays, &mut shares);
            let [white, black] = [1.0, 0.0].map(|v| {
                let mut groups = rays;
                groups.iter_mut().for_each(|group| group.rgb = [[v; GROUP]; 3]);
                atmosphere.shade(path, origin, &mut groups);
                groups
            });
            for i in 0..256 {
                let (g, lane) = (i / GROUP, i % GROUP);
                let direction = [0, 1, 2].map(|k| f64::from(rays[g].direction[k][lane]));
                let distance = f64::from(rays[g].distance[lane]);
                let want = atmosphere.evaluate_reference(origin.map(f64::from), direction, distance);
                let rise = dot(direction, SITE.up);
                let tolerance = 1e-5 + 4e-7 / rise.abs().max(1e-7);
                for k in 0..3 {
                    let (kept, added) = (air[g].transmittance[k][lane], air[g].airlight[k][lane]);
                    assert_eq!(kept, shares[g][k][lane]);
                    assert!((f64::from(kept) - want.transmittance[k]).abs() < tolerance);
                    assert!((f64::from(added) - want.airlight[k]).abs() < tolerance);
                    let decoded = |groups: &[ShadeGroup; 16]| srgb_decode(f64::from(groups[g].rgb[k][lane]));
                    let difference = decoded(&white) - decoded(&black);
                    assert!((f64::from(kept) - difference).abs() < 4e-6, "{kept}, and {difference}");
                }
            }
        }
    }
}

/// The closed form against a fine march through the layer.
#[test]
fn height_fog_is_the_integral_of_its_density() {
    let layer = AirLayer { base_height: 3.0, ..layer(1.0, 20.0) };
    for (height, rise, metres) in
        [(1.6, 0.0, 500.0), (1.6, 0.5, 300.0), (80.0, -0.4, 220.0), (5.0, -1e-5, 900.0), (2.0, 1.0, 1e5)]
    {
        let steps = 2_000_000;
        let step = metres / f64::from(steps);
        let density = |i: i32| (-(height + rise * (f64::from(i) + 0.5) * step - 3.0) / 20.0f64).exp();
        let marched: f64 = (0..steps).map(density).sum::<f64>() * step;
        let closed = Atmosphere::path_length(&layer, height, rise, metres);
        assert!((closed / marched - 1.0).abs() < 1e-4, "{height} {rise} {metres}: {closed}, want {marched}");
    }
}

#[test]
fn published_numbers_come_out() {
    // Extinction at MOR 50 to 5000 m, and the ratio of the two visual ranges.
    for (mor, sigma) in
        [(50.0, 0.0599), (200.0, 0.0150), (500.0, 0.00599), (1000.0, 0.0030), (5000.0, 0.0006)]
    {
        assert!((sigma_of_mor(mor) / sigma - 1.0f64).abs() < 0.003);
    }
    assert!((sigma_of_visual_range(1000.0) - 0.003_912).abs() < 1e-6);
    // Haze by wavelength at Angstrom exponent 1.3.
    for (got, want) in spectrum(1.3).into_iter().zip([0.874, 1.0, 1.244]) {
        assert!((got - want).abs() < 1e-3);
    }
}

#[test]
fn clear_air_is_no_air() {
    let clear = Atmosphere::new(vec![layer(0.0, f64::INFINITY)], SITE);
    assert!(clear.is_clear());
    assert_eq!(clear.reference([0.0; 3], [1.0, 0.0, 0.0], 50.0, [0.2, 0.3, 0.4]), [0.2, 0.3, 0.4]);
}

proptest! {
    /// More air never lets more of the scene through; the far end is the airlight.
    #[test]
    fn fog_is_monotone_and_ends_in_its_airlight(mor in 20.0..5000.0f64, near in 0.1..500.0f64, more in 0.1..500.0f64) {
        let layer = AirLayer { sigma_t: [sigma_of_mor(mor); 3], ..layer(1.0, f64::INFINITY) };
        let air = Atmosphere::new(vec![layer], SITE);
        let seen = |distance: f64| air.reference([0.0; 3], [0.0, 0.0, 1.0], distance, [0.0; 3])[0];
        prop_assert!(seen(near) <= seen(near + more));
        prop_assert!((seen(f64::INFINITY) - srgb_encode(0.5)).abs() < 1e-9);
    }
}
