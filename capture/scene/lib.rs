//! Scenes: [`scene`] (triangles, materials, lights in memory), [`load`] (OBJ, glTF), [`save`] (the
//! same, written), [`camera_path`] (cameras and paths as JSON).

pub mod camera_path;
mod lights;
pub mod load;
pub mod material;
pub mod save;
pub mod scene;
mod set_light;
mod sky_picture;
mod sky_sun;
mod stitch;
pub mod subdivide;
mod surface;
