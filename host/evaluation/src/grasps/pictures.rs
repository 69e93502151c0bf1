//! What goes wrong between camera and microcontroller, as the host marks it: a black picture sends the last good map
//! again and doubts it, a missing one sends nothing, a late one comes with its own capture time, a repeated one repeats.

use gripline_protocol::{ForceMap, Health, Motion};

/// What is wrong with a picture.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Kind {
    /// Too dark to see anything.
    Black,
    /// None comes.
    Missing,
    /// The first picture of the fault is delivered at its end; the others are lost.
    Late,
    /// The last good one again, with the capture time that it had.
    Repeated,
    /// The last good one again, with a new capture time.
    Frozen,
}

/// Pictures that are not as they should be.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct PictureFault {
    /// What is wrong.
    pub kind: Kind,
    /// The first picture, counted from the start.
    pub from: u32,
    /// How many.
    pub count: u32,
}

/// A map as it comes to the microcontroller.
#[derive(Debug, Clone, PartialEq)]
pub(super) struct Delivered {
    pub(super) map: ForceMap,
    pub(super) health: Health,
    pub(super) motion: Motion,
    /// How many pictures ago it was taken.
    pub(super) age: u32,
}

/// The delivery of pictures from camera to microcontroller.
pub(super) struct Delivery<'a> {
    picture_faults: &'a [PictureFault],
    /// The last good map and its picture.
    last: (ForceMap, u32),
    late: Option<ForceMap>,
}

impl<'a> Delivery<'a> {
    pub(super) fn new(picture_faults: &'a [PictureFault]) -> Self {
        Self {
            picture_faults,
            last: (ForceMap::EMPTY, 0),
            late: None,
        }
    }

    /// The delivered map when picture number `number` would give `map`; `None` if it is lost.
    pub(super) fn deliver(
        &mut self,
        number: u32,
        (map, health, motion): (ForceMap, Health, Motion),
    ) -> Option<Delivered> {
        let fault = self
            .picture_faults
            .iter()
            .find(|fault| (fault.from..fault.from + fault.count).contains(&number));
        let Some(fault) = fault else {
            if health.is_good() {
                self.last = (map.clone(), number);
            }
            return Some(Delivered {
                map,
                health,
                motion,
                age: 0,
            });
        };
        let (last, taken) = &self.last;
        let again = |health, age| {
            Some(Delivered {
                map: last.clone(),
                health,
                motion: Motion::UNKNOWN,
                age,
            })
        };
        match fault.kind {
            Kind::Missing => None,
            Kind::Black => again(Health::TOO_DARK, 0),
            Kind::Frozen => again(Health::GOOD, 0),
            Kind::Repeated => again(Health::GOOD, number - taken),
            Kind::Late => {
                let map = self.late.take().unwrap_or(map);
                if number + 1 < fault.from + fault.count {
                    self.late = Some(map);
                    return None;
                }
                self.last = (map.clone(), fault.from);
                Some(Delivered {
                    map,
                    health,
                    motion: Motion::UNKNOWN,
                    age: fault.count - 1,
                })
            }
        }
    }
}

#[cfg(test)]
mod tests {
    use gripline_protocol::TaxelForce;

    use super::*;

    fn map(number: u32) -> ForceMap {
        let mut map = ForceMap::EMPTY;
        map.taxels[0] = TaxelForce {
            x: 0,
            y: 0,
            z: number as i16,
        };
        map
    }

    /// (map, good, age) of eight pictures of which two, three and four are faulty.
    fn seen(kind: Kind) -> Vec<Option<(i16, bool, u32)>> {
        let picture_faults = [PictureFault {
            kind,
            from: 2,
            count: 3,
        }];
        let mut delivery = Delivery::new(&picture_faults);
        (0..6)
            .map(|number| {
                let came = delivery.deliver(number, (map(number), Health::GOOD, Motion::UNKNOWN))?;
                Some((came.map.taxels[0].z, came.health.is_good(), came.age))
            })
            .collect()
    }

    #[test]
    fn every_trouble_shows_as_the_host_marks_it_and_ends() {
        let good = |number: i16| Some((number, true, 0));
        let around = |[a, b, c]: [Option<(i16, bool, u32)>; 3]| vec![good(0), good(1), a, b, c, good(5)];
        assert_eq!(seen(Kind::Missing), around([None; 3]));
        assert_eq!(seen(Kind::Black), around([Some((1, false, 0)); 3]));
        assert_eq!(seen(Kind::Frozen), around([good(1); 3]));
        let repeated = [1, 2, 3].map(|age| Some((1, true, age)));
        assert_eq!(seen(Kind::Repeated), around(repeated));
        assert_eq!(seen(Kind::Late), around([None, None, Some((2, true, 2))]));
    }
}
