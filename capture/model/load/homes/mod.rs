//! Sweet Home 3D homes: the `plan` becomes cells and portals (`sweethome`, `rooms`, `doors`), over
//! the geometry of an exported OBJ (`export_file`) or of the plan itself (`plain`).

mod additions;
mod archive;
mod ceilings;
mod doors;
mod export_file;
mod leaves;
mod plain;
mod plan;
mod rooms;
pub(super) mod sweethome;
