//! Portal models: from homes, from TOML, and their defects.

mod home_details;
mod homes;
mod load_apartment;
mod load_home;
mod load_toml_model;
mod open_plan;
mod portal_model;
