//! [`Field`]: one array of a scene.

use std::fmt;

/// One array of a [`crate::Scene`].
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord)]
pub enum Field {
    /// [`crate::Scene::means`].
    Mean,
    /// [`crate::Scene::rotations`].
    Rotation,
    /// [`crate::Scene::log_scales`].
    LogScale,
    /// [`crate::Scene::opacity_logits`].
    OpacityLogit,
    /// [`crate::Scene::sh`].
    Sh,
}

impl Field {
    /// All fields, in the order in which they are checked.
    pub const ALL: [Self; 5] =
        [Self::Mean, Self::Rotation, Self::LogScale, Self::OpacityLogit, Self::Sh];
}

impl fmt::Display for Field {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str(match self {
            Self::Mean => "mean",
            Self::Rotation => "rotation",
            Self::LogScale => "log-scale",
            Self::OpacityLogit => "opacity logit",
            Self::Sh => "SH coefficient",
        })
    }
}
