//! Table of the clear sky: 3,600 published numbers (`table.csv`), and their licence.
//!
//! Source: `ArHosekSkyModelData_RGB.h` of the sample implementation 1.4a (22 February 2013) by
//! Lukas Hosek and Alexander Wilkie, Charles University in Prague, to "An Analytic Model for Full
//! Spectral Sky-Dome Radiance" (ACM Transactions on Graphics 31(4), 2012),
//! <https://cgg.mff.cuni.cz/projects/SkylightModelling/>. Only the numbers are theirs, in another
//! order and as f32. They come under the 3-clause BSD licence:
//!
//! ```text
//! Copyright (c) 2012 - 2013, Lukas Hosek and Alexander Wilkie
//! All rights reserved.
//!
//! Redistribution and use in source and binary forms, with or without
//! modification, are permitted provided that the following conditions are met:
//!
//!     * Redistributions of source code must retain the above copyright
//!       notice, this list of conditions and the following disclaimer.
//!     * Redistributions in binary form must reproduce the above copyright
//!       notice, this list of conditions and the following disclaimer in the
//!       documentation and/or other materials provided with the distribution.
//!     * None of the names of the contributors may be used to endorse or promote
//!       products derived from this software without specific prior written
//!       permission.
//!
//! THIS SOFTWARE IS PROVIDED BY THE COPYRIGHT HOLDERS AND CONTRIBUTORS "AS IS" AND
//! ANY EXPRESS OR IMPLIED WARRANTIES, INCLUDING, BUT NOT LIMITED TO, THE IMPLIED
//! WARRANTIES OF MERCHANTABILITY AND FITNESS FOR A PARTICULAR PURPOSE ARE
//! DISCLAIMED. IN NO EVENT SHALL THE COPYRIGHT HOLDERS BE LIABLE FOR ANY
//! DIRECT, INDIRECT, INCIDENTAL, SPECIAL, EXEMPLARY, OR CONSEQUENTIAL DAMAGES
//! (INCLUDING, BUT NOT LIMITED TO, PROCUREMENT OF SUBSTITUTE GOODS OR SERVICES;
//! LOSS OF USE, DATA, OR PROFITS; OR BUSINESS INTERRUPTION) HOWEVER CAUSED AND
//! ON ANY THEORY OF LIABILITY, WHETHER IN CONTRACT, STRICT LIABILITY, OR TORT
//! (INCLUDING NEGLIGENCE OR OTHERWISE) ARISING IN ANY WAY OUT OF THE USE OF THIS
//! SOFTWARE, EVEN IF ADVISED OF THE POSSIBILITY OF SUCH DAMAGE.
//! ```

use std::sync::LazyLock;

/// Nine coefficients A B C D E F G I H of the paper's formula, then the radiance factor.
type ControlPoint = [f32; 10];

static TABLE: LazyLock<Vec<ControlPoint>> = LazyLock::new(|| {
    let lines = include_str!("table.csv").lines().filter(|line| !line.starts_with('#'));
    let point = |line: &str| {
        let mut numbers = line.split(',').map(|number| number.parse().expect("the table has numbers"));
        std::array::from_fn(|_| numbers.next().expect("a control point has ten numbers"))
    };
    lines.map(point).collect()
});

/// The six control points over the elevation of the sun, by channel (red, green, blue), ground
/// albedo (0, 1) and row of turbidity (0 for 1 to 9 for 10).
pub(super) fn control_points(channel: usize, albedo: usize, turbidity: usize) -> &'static [ControlPoint] {
    &TABLE[6 * (10 * (2 * channel + albedo) + turbidity)..][..6]
}
