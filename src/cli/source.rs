//! What the file of a cloud said beside points, fields and faces: `source.json` in a directory of results.
//!
//! `bases.ply` has the cloud itself; what PLY has no place for stands here, so that a filtered survey leaves as LAS with the
//! records it came with.

use chladni::cloud::{CloudError, Grid, Origin, PointCloud};
use serde::{Deserialize, Serialize};

/// Name of the file.
pub(super) const SOURCE: &str = "source.json";

/// What PLY does not keep of a cloud.
#[derive(Debug, Serialize, Deserialize)]
pub(super) struct Source {
    /// Grids of x, y and z.
    grids: Option<[Grid; 3]>,
    /// Notes of the reader, header and records of LAS.
    origin: Origin,
    /// Triangles that continue the polygon of the one before.
    continued: Vec<u32>,
}

impl Source {
    /// `None` where PLY keeps everything.
    pub(super) fn of(cloud: &PointCloud) -> Option<Self> {
        let (grids, origin, continued) = (cloud.grids(), cloud.origin().clone(), cloud.continued().to_vec());
        let is_kept = grids.is_none() && origin.is_empty() && continued.is_empty();
        (!is_kept).then_some(Self { grids, origin, continued })
    }

    /// The cloud with it.
    ///
    /// # Errors
    /// [`CloudError`] when it is another cloud's.
    pub(super) fn added_to(self, cloud: PointCloud) -> Result<PointCloud, CloudError> {
        cloud.with_grids(self.grids).with_origin(self.origin).with_polygons(self.continued)
    }
}
