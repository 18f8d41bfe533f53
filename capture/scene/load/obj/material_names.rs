//! Lookup of the materials that an OBJ uses by name.

use super::mtl::MtlMaterial;
use crate::load::encoding::respellings;
use crate::load::lines::without_comment;
use std::collections::HashMap;

/// Indices of materials by their names; the later one of two with the same name counts.
pub struct MaterialNames {
    /// By the names as the file has them.
    exact: HashMap<String, usize>,
    /// By the names without a comment, and as they are in other encodings.
    similar: HashMap<String, usize>,
}

impl MaterialNames {
    /// Indexes materials by their names.
    pub fn new(materials: &[MtlMaterial]) -> Self {
        let (mut exact, mut similar) = (HashMap::new(), HashMap::new());
        for (index, material) in materials.iter().enumerate() {
            exact.insert(material.name.clone(), index);
            for name in spellings(&material.name) {
                similar.insert(name, index);
            }
        }
        Self { exact, similar }
    }

    /// Returns the index of the material that a `usemtl` names: exactly, else without a comment
    /// behind either name, else composed or in another encoding, because an OBJ and its MTL may
    /// differ in it, else before a number sign.
    pub fn find(&self, name: &str) -> Option<usize> {
        if let Some(index) = self.exact.get(name) {
            return Some(*index);
        }
        std::iter::once(name.to_owned())
            .chain(spellings(name))
            .find_map(|name| self.exact.get(&name).or(self.similar.get(&name)))
            .or_else(|| self.exact.get(name.split_once('#')?.0.trim_end()))
            .copied()
    }
}

/// Returns other spellings of a name, the likeliest first.
fn spellings(name: &str) -> Vec<String> {
    let mut names = Vec::new();
    if let Some(name) = without_comment(name) {
        names.push(name.to_owned());
        names.extend(respellings(name));
    }
    names.extend(respellings(name));
    names
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn names_are_found_without_comments_and_in_other_encodings() {
        let material = |name: &str| MtlMaterial {
            name: name.into(),
            ..MtlMaterial::default()
        };
        let decomposed = "Tu\u{308}r";
        let materials = [
            "r # red",
            "木",
            "Material #25",
            "a # b",
            "a # c",
            decomposed,
            "grün",
            "s",
        ];
        let materials = materials.map(material);
        let names = MaterialNames::new(&materials);
        for (name, index) in [
            ("r # wall", Some(0)),
            ("r", Some(0)),
            ("r #wall", Some(0)),
            ("ľ", Some(1)),
            ("Material #25", Some(2)),
            ("Material #26", None),
            ("a # b", Some(3)),
            ("a # c", Some(4)),
            ("T\u{fc}r", Some(5)),
            ("gru\u{308}n", Some(6)),
            ("s #1 of 2", Some(7)),
        ] {
            assert_eq!(names.find(name), index, "{name}");
        }
    }
}
