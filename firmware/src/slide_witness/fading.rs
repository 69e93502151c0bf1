//! Friction that falls slowly under a line that falls: shear and normal force sink together, too slowly for the slots.
//! Units: force 1/4096 N, shares 1/1024.

use crate::arithmetic::change;
use crate::constants::FADE_SHARE;

/// Slow means of shear and normal force, and what they were when one of them last rose.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub(super) struct Fading {
    slow: [i32; 2],
    since: [i32; 2],
}

impl Fading {
    /// Takes shear and normal force of a slot. Whether they have slowly sunk together since one of them last rose.
    pub(super) fn fades(&mut self, shear: i32, normal: i32) -> bool {
        let [slow_shear, slow_normal] = &mut self.slow;
        *slow_shear += (shear - *slow_shear) / 8;
        *slow_normal += (normal - *slow_normal) / 8;
        if *slow_shear > self.since[0] || *slow_normal > self.since[1] {
            self.since = [*slow_shear, *slow_normal];
        }
        let changes = [
            change(*slow_shear, self.since[0]),
            change(*slow_normal, self.since[1]),
        ];
        let fades = sink_together(changes, FADE_SHARE) && shear <= *slow_shear + *slow_shear / 64;
        if fades {
            self.since = self.slow;
        }
        fades
    }

    /// What sank before says nothing of what comes.
    pub(super) const fn restart(&mut self, shear: i32, normal: i32) {
        self.slow = [shear, normal];
        self.since = self.slow;
    }
}

/// Whether the normal force has sunk by more than a share, and the shear by at least seven tenths as much.
pub(super) const fn sink_together([of_shear, of_normal]: [i32; 2], share: i32) -> bool {
    of_normal < -share && 10 * of_shear < 7 * of_normal
}
