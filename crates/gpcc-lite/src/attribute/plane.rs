//! The levels of one channel, until they are coded all at once.

/// Levels in coefficient order, a byte each: few do not fit, and those are kept apart. As words,
/// the levels of a group would take as much memory as its values.
pub(super) struct Plane {
    small: Vec<i8>,
    /// Coefficient and level, ascending, where the byte is [`Plane::LARGE`].
    large: Vec<(u32, i32)>,
}

impl Plane {
    const LARGE: i8 = i8::MIN;

    /// Zeros.
    pub(super) fn new(coefficients: usize) -> Self {
        Self { small: vec![0; coefficients], large: Vec::new() }
    }

    /// Sets a level; called for ascending coefficients, at most once for each.
    #[inline]
    pub(super) fn set(&mut self, k: usize, level: i32) {
        self.small[k] = match i8::try_from(level) {
            Ok(small) if small != Self::LARGE => small,
            _ => {
                self.large.push((k as u32, level));
                Self::LARGE
            }
        };
    }

    /// All levels.
    pub(super) fn levels(&self) -> Vec<i32> {
        let mut levels: Vec<i32> = self.small.iter().map(|&v| i32::from(v)).collect();
        for &(k, level) in &self.large {
            levels[k as usize] = level;
        }
        levels
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn levels_of_any_size_come_back() {
        let levels = [0, 1, -1, 127, -127, -128, 128, 0, i32::MAX, i32::MIN, -129, 5];
        let mut plane = Plane::new(levels.len() + 1);
        for (k, &level) in levels.iter().enumerate().filter(|(_, level)| **level != 0) {
            plane.set(k, level);
        }
        assert_eq!(plane.large.len(), 5);
        assert_eq!(plane.levels()[..levels.len()], levels);
        assert_eq!(plane.levels()[levels.len()..], [0]);
    }
}
