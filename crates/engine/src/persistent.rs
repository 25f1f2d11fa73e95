//! A vector that shares unchanged parts: the engine edits its own copy, each snapshot holds another, and an
//! edit copies only the path to the changed element.

use std::sync::Arc;

const BITS: u32 = 3;
const WIDTH: usize = 1 << BITS;

/// A persistent vector: `clone` costs one reference count, `get_mut` copies at most one path of
/// nodes of 8 entries, and nothing where no snapshot shares it.
#[derive(Debug, Clone)]
pub struct PersistentVec<T> {
    root: Arc<Node<T>>,
    len: usize,
    /// Bits of an index that are resolved below the root.
    shift: u32,
}

#[derive(Debug, Clone, PartialEq, Eq)]
enum Node<T> {
    Branch(Vec<Arc<Node<T>>>),
    Leaf(Vec<T>),
}

impl<T> Default for PersistentVec<T> {
    fn default() -> PersistentVec<T> {
        PersistentVec { root: Arc::new(Node::Leaf(Vec::new())), len: 0, shift: 0 }
    }
}

impl<T> PersistentVec<T> {
    pub fn len(&self) -> usize {
        self.len
    }

    pub fn is_empty(&self) -> bool {
        self.len == 0
    }

    pub fn get(&self, index: usize) -> Option<&T> {
        if index >= self.len {
            return None;
        }
        let mut node = &*self.root;
        let mut shift = self.shift;
        loop {
            match node {
                Node::Leaf(items) => return items.get(index & (WIDTH - 1)),
                Node::Branch(children) => node = &children[(index >> shift) & (WIDTH - 1)],
            }
            shift = shift.saturating_sub(BITS);
        }
    }

    pub fn iter(&self) -> impl Iterator<Item = &T> {
        (0..self.len).filter_map(|index| self.get(index))
    }
}

impl<T: Clone> PersistentVec<T> {
    pub fn get_mut(&mut self, index: usize) -> Option<&mut T> {
        if index >= self.len {
            return None;
        }
        let mut node = &mut self.root;
        let mut shift = self.shift;
        loop {
            match Arc::make_mut(node) {
                Node::Leaf(items) => return items.get_mut(index & (WIDTH - 1)),
                Node::Branch(children) => node = &mut children[(index >> shift) & (WIDTH - 1)],
            }
            shift = shift.saturating_sub(BITS);
        }
    }

    pub fn push(&mut self, item: T) {
        if self.len == WIDTH << self.shift {
            let old = std::mem::replace(&mut self.root, Arc::new(Node::Branch(room())));
            if let Node::Branch(children) = Arc::make_mut(&mut self.root) {
                children.push(old);
            }
            self.shift += BITS;
        }
        let index = self.len;
        self.len += 1;
        let mut node = &mut self.root;
        let mut shift = self.shift;
        loop {
            match Arc::make_mut(node) {
                Node::Leaf(items) => return items.push(item),
                Node::Branch(children) => {
                    let slot = (index >> shift) & (WIDTH - 1);
                    if slot == children.len() {
                        // Room for all entries from the start: a list that grows leaves holes behind.
                        let is_leaf = shift == BITS;
                        let empty = if is_leaf { Node::Leaf(room()) } else { Node::Branch(room()) };
                        children.push(Arc::new(empty));
                    }
                    node = &mut children[slot];
                }
            }
            shift = shift.saturating_sub(BITS);
        }
    }
}

fn room<T>() -> Vec<T> {
    Vec::with_capacity(WIDTH)
}

/// Shared nodes are not compared. Two vectors of equal length have nodes of equal shape.
impl<T: Eq> PartialEq for PersistentVec<T> {
    fn eq(&self, other: &PersistentVec<T>) -> bool {
        // `Arc` compares by address first, because the items are `Eq`.
        self.len == other.len && self.root == other.root
    }
}

impl<T: Eq> Eq for PersistentVec<T> {}

impl<T> std::ops::Index<usize> for PersistentVec<T> {
    type Output = T;

    /// # Panics
    ///
    /// If `index` is not below `len`, as for a slice.
    fn index(&self, index: usize) -> &T {
        self.get(index).unwrap_or_else(|| panic!("index {index} of {}", self.len))
    }
}

impl<T: Clone> FromIterator<T> for PersistentVec<T> {
    fn from_iter<I: IntoIterator<Item = T>>(items: I) -> PersistentVec<T> {
        let mut vec = PersistentVec::default();
        for item in items {
            vec.push(item);
        }
        vec
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_copy_keeps_what_it_saw() {
        for len in [0, 1, 31, 32, 33, 1024, 1025, 40_000] {
            let mut vec: PersistentVec<usize> = (0..len).collect();
            let before = vec.clone();
            assert_eq!(vec.len(), len);
            for index in 0..len {
                *vec.get_mut(index).unwrap() += 1;
            }
            assert!(before.iter().copied().eq(0..len), "{len}");
            assert!(vec.iter().copied().eq(1..=len), "{len}");
            assert!(vec == (1..=len).collect() && (len == 0) == (vec == before), "{len}");
            assert!(vec.get(len).is_none() && vec.get_mut(len).is_none());
        }
    }
}
