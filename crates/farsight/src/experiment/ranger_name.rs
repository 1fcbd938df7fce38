//! What rangers are called.

use serde::Deserialize;

/// Names of the rangers, as plans of experiments have them.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Deserialize)]
#[serde(rename_all = "snake_case")]
pub(crate) enum RangerName {
    /// The mean height of the class over the height of the 2D box.
    SimilarTriangles,
    /// The bottom edge of the 2D box on flat ground.
    InversePerspective,
    /// The same with the horizon that the boxes of the image ask for.
    EstimatedHorizon,
    /// GS3D's first step: a cuboid of the class's mean size that fills the 2D box.
    Guidance,
    /// A multi-layer perceptron on the sides of the 2D box.
    BoxMlp,
    /// The median of the true depth of the pixels in the 2D box.
    MedianDepth,
}

impl RangerName {
    /// All of them.
    pub(crate) const ALL: [Self; 6] = [
        Self::SimilarTriangles,
        Self::InversePerspective,
        Self::EstimatedHorizon,
        Self::Guidance,
        Self::BoxMlp,
        Self::MedianDepth,
    ];

    /// The name in result files.
    pub(crate) fn word(self) -> &'static str {
        match self {
            Self::SimilarTriangles => "similar_triangles",
            Self::InversePerspective => "inverse_perspective",
            Self::EstimatedHorizon => "estimated_horizon",
            Self::Guidance => "guidance",
            Self::BoxMlp => "box_mlp",
            Self::MedianDepth => "median_depth",
        }
    }

    /// What it does, for people.
    pub(crate) fn description(self) -> &'static str {
        match self {
            Self::SimilarTriangles => "similar triangles: mean height of the class over the height of the 2D box",
            Self::InversePerspective => "inverse perspective: the bottom edge of the 2D box on flat ground",
            Self::EstimatedHorizon => "inverse perspective with the horizon that the boxes of the image ask for",
            Self::Guidance => "GS3D's guidance: a cuboid of the class's mean size that fills the 2D box",
            Self::BoxMlp => "a multi-layer perceptron on the sides of the 2D box (after DisNet)",
            Self::MedianDepth => "the median of the true depth of the pixels in the 2D box",
        }
    }
}
