//! Scenes: [`scene`] (triangles, materials and lights in memory), [`load`] (OBJ and glTF files),
//! [`save`] (OBJ and GLB files), [`camera_path`] (cameras and paths as JSON).

pub mod camera_path;
pub mod coplanar;
mod lights;
pub mod load;
pub mod material;
pub mod save;
pub mod scene;
mod set_light;
mod sky_file;
mod sky_picture;
mod sky_sun;
mod stitch;
pub mod subdivide;
mod surface;
