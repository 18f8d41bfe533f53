//! Plan of a home, read from its `Home.xml`: storeys, rooms, furniture and openings (`home`),
//! walls, finishes, and what is not supported.

pub(super) mod finish;
pub(super) mod home;
pub(super) mod unsupported;
pub(super) mod walls;
mod xml;
