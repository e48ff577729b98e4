//! The list of all layers.

/// Hands the list of layers to a macro. An entry is the variant, the constant and the name of a
/// layer, and its row, which [`super::table`] alone reads. Messages list layers in this order, and
/// layers that are pictures of their own are drawn in it.
macro_rules! layers {
    ($use_list:ident) => {
        $use_list! {
            /// The colour.
            Color COLOR "rgb" = row("", RGB, Frame(|_| {}), LayerForm::Color, |p| (&p.frame.rgb).into());
            /// Expected depth, metres.
            Depth DEPTH "depth" = row(
                "metres", &["Z"], EXPECTED_DEPTH, LayerForm::Depth, |p| p.metres(&p.frame.depth),
            );
            /// Median depth, metres.
            MedianDepth MEDIAN_DEPTH "median-depth" = row(
                "", &["Z"], MEDIAN_DEPTH, LayerForm::Depth, |p| p.metres(&p.frame.median_depth),
            );
            /// Normals, world axes, as blended: length 1 on one flat surface.
            Normal NORMAL "normal" = row(
                "", &["X", "Y", "Z"], NORMALS, LayerForm::Normal, |p| (&p.frame.normal).into(),
            );
            /// Coverage, 0-1.
            Alpha ALPHA "alpha" = row("", &["A"], Frame(|_| {}), SHARE_16, |p| (&p.frame.alpha).into());
            /// The share of the scene's light that the air lets through.
            Transmittance TRANSMITTANCE "transmittance" = row(
                "of the air: one more render", RGB, Part(PicturePart::Transmittance),
                LayerForm::ColorShares, |p| (&p.parts.transmittance).into(),
            );
            /// Falling particles, and their coverage.
            Particles PARTICLES "particles" = row(
                "rain and snow in the air, with their coverage", &["R", "G", "B", "A"],
                Frame(|outputs| outputs.particles = ParticlePass::On),
                LayerForm::Particles, |p| (&p.frame.particles).into(),
            );
            /// The scene without air and without falling particles, linear RGB.
            Clean CLEAN "clean" = row(
                "without air and particles: one more", RGB, Part(PicturePart::Clean),
                LayerForm::Light, |p| (&p.parts.clean).into(),
            );
            /// The light that the air adds, linear RGB.
            Airlight AIRLIGHT "airlight" = row(
                "light that the air adds: three more", RGB, Part(PicturePart::Airlight),
                LayerForm::Light, |p| (&p.parts.airlight).into(),
            );
            /// Visible water: the share of a pixel that its surface covers, 0-1.
            Water WATER "water" = row(
                "its share of a pixel", &["A"], WATER_SURFACE, SHARE_8, |p| p.or_zeros(&p.water.cover),
            );
            /// Reflections: the share of a pixel's light that the water mirrors, 0-1.
            Reflection REFLECTION "reflection" = row(
                "of a pixel's light", &["A"], WATER_SURFACE, SHARE_8, |p| p.or_zeros(&p.water.reflected),
            );
            /// Depth of the water's surface, metres, 0 where there is none.
            WaterDepth WATER_DEPTH "water-depth" = row(
                "metres", &["Z"], WATER_SURFACE, LayerForm::Depth, |p| p.metres(&p.or_zeros(&p.water.depth)),
            );
            /// Optical flow of falling rain, snow and hail to the next frame, px to the right and
            /// down; NaN where nothing falls.
            ParticleFlow PARTICLE_FLOW "particle-flow" = flow::particles::ROW;
            /// Optical flow of the scene to the next frame, px to the right and down.
            Flow FLOW "flow" = flow::ROW;
            /// The fate of each pixel of the flow: the numbers of [`crate::flow::FlowState`].
            FlowMask FLOW_MASK "flow-mask" = flow::MASK_ROW;
            /// Motion vectors of temporal upscalers: from each pixel to where the frame before
            /// showed the same point, px to the right and down; 0 in the first frame, and for
            /// points that the frame before could not show.
            Motion MOTION "motion" = flow::motion::ROW;
            /// The label of what each pixel shows, 0 for none.
            Label LABEL "label" = labels::LABEL_ROW;
            /// The instance ID of the object that each pixel shows, 0 for none.
            Instance INSTANCE "instance" = labels::INSTANCE_ROW;
            /// Depth of the surfaces, metres, without what falls and without the scene's own sky:
            /// the expected depth where it agrees with the median, else the median; 0 in the sky.
            SurfaceDepth SURFACE_DEPTH "surface-depth" = flow::DEPTH_ROW;
            /// The view without any weather, in the light and under the sky of the photos.
            Clear CLEAR "clear" = clear::ROW;
        }
    };
}
