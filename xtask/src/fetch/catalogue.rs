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
    /// What is wanted of a scene's folder in it.
    pub(crate) wants: &'static [Want],
}

/// Entries of a scene's folder in an archive, under the names that they get on disk. The first
/// of an archive is the one by which the folder is found.
#[derive(Debug)]
pub(crate) enum Want {
    /// One file, under the first of these names that is there.
    File { from: &'static [&'static str], to: &'static [&'static str] },
    /// All photos of a folder.
    Photos { folder: &'static str },
}

/// Trained models: `SCENE/point_cloud/iteration_30000/point_cloud.ply`, `SCENE/cameras.json`.
static MODELS: Archive = Archive {
    file: "models.zip",
    folder: "pretrained",
    size: "14 GB",
    wants: &[
        Want::File {
            from: &["point_cloud/iteration_30000/point_cloud.ply"],
            to: &["point_cloud.ply"],
        },
        Want::File { from: &["cameras.json"], to: &["cameras.json"] },
    ],
};

/// Photos and COLMAP models: `tandt/SCENE/` and `db/SCENE/`. The points that COLMAP found are
/// left out: nothing here reads them.
static PHOTOS: Archive = Archive {
    file: "tandt_db.zip",
    folder: "input",
    size: "650 MB",
    wants: &[
        Want::File {
            from: &["sparse/0/cameras.bin", "sparse/0/cameras.txt"],
            to: &["sparse/0/cameras.bin", "sparse/0/cameras.txt"],
        },
        Want::File {
            from: &["sparse/0/images.bin", "sparse/0/images.txt"],
            to: &["sparse/0/images.bin", "sparse/0/images.txt"],
        },
        Want::Photos { folder: "images/" },
    ],
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
    /// The scene of that name.
    pub(crate) fn named(name: &str) -> Option<Self> {
        SCENES.into_iter().find(|s| s.name == name)
    }

    /// The archives that hold it, each with the scene's folder.
    pub(crate) fn archives(&self) -> [(&'static Archive, String); 2] {
        [(&PHOTOS, self.photos.to_owned()), (&MODELS, format!("{}/", self.name))]
    }
}
