//! The public archives of Inria's 3D Gaussian Splatting, and what is needed out of them.

/// Folder of the archives on Inria's server.
pub(crate) const PUBLIC: &str = "https://repo-sam.inria.fr/fungraph/3d-gaussian-splatting/datasets";

/// A public archive.
#[derive(Debug)]
pub(crate) struct Archive {
    /// File name.
    pub(crate) file: &'static str,
    /// Folder below [`PUBLIC`].
    pub(crate) folder: &'static str,
    /// Size in words.
    pub(crate) size: &'static str,
    /// Files that are wanted of a scene's folder in it, each under one of several names, with its
    /// name on disk.
    pub(crate) files: &'static [&'static [(&'static str, &'static str)]],
    /// Folder of which all photos are wanted.
    pub(crate) photos: Option<&'static str>,
}

/// Trained models: `SCENE/point_cloud/iteration_30000/point_cloud.ply`, `SCENE/cameras.json`.
static MODELS: Archive = Archive {
    file: "models.zip",
    folder: "pretrained",
    size: "14 GB",
    files: &[
        &[("point_cloud/iteration_30000/point_cloud.ply", "point_cloud.ply")],
        &[("cameras.json", "cameras.json")],
    ],
    photos: None,
};

/// Photos and COLMAP models: `tandt/SCENE/` and `db/SCENE/`. COLMAP's points are left out: nothing
/// here reads them.
static PHOTOS: Archive = Archive {
    file: "tandt_db.zip",
    folder: "input",
    size: "650 MB",
    files: &[
        &[
            ("sparse/0/cameras.bin", "sparse/0/cameras.bin"),
            ("sparse/0/cameras.txt", "sparse/0/cameras.txt"),
        ],
        &[
            ("sparse/0/images.bin", "sparse/0/images.bin"),
            ("sparse/0/images.txt", "sparse/0/images.txt"),
        ],
    ],
    photos: Some("images/"),
};

/// A scene that can be fetched.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Scene {
    /// Name in the registry.
    pub(crate) name: &'static str,
    /// Folder of photos in `tandt_db.zip`.
    photos: &'static str,
}

/// The scenes, in the order of the paper.
pub(crate) const SCENES: [Scene; 4] = [
    Scene { name: "playroom", photos: "db/playroom/" },
    Scene { name: "truck", photos: "tandt/truck/" },
    Scene { name: "train", photos: "tandt/train/" },
    Scene { name: "drjohnson", photos: "db/drjohnson/" },
];

impl Scene {
    /// The archives that hold it, each with the scene's folder.
    pub(crate) fn archives(&self) -> [(&'static Archive, String); 2] {
        [(&PHOTOS, self.photos.to_owned()), (&MODELS, format!("{}/", self.name))]
    }
}
