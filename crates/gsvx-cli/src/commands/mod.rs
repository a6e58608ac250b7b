//! The commands, a file each: flags, order of the work, and what is said.

pub(crate) mod compare;
pub(crate) mod convert;
pub(crate) mod decode;
pub(crate) mod encode;
pub(crate) mod info;
pub(crate) mod join;
pub(crate) mod lod;
pub(crate) mod plan;
pub(crate) mod render;
pub(crate) mod sequence;
pub(crate) mod tune;
pub(crate) mod view;
