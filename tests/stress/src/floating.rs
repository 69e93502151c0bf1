//! The detector in floating point, as one would write it: what the one in whole numbers is compared with. Contact, stick,
//! total force, moment and centre of pressure of a whole map. Units: newtons, millimetres.

/// How a float asks whether a taxel sticks.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Form {
    /// √(fx² + fy²) ≤ μ fz, as the paper writes it.
    Root,
    /// fx² + fy² ≤ μ² fz².
    Squares,
}

macro_rules! detector {
    ($name:ident, $real:ty, $what:literal) => {
        #[doc = $what]
        pub mod $name {
            use super::Form;
            use gripline_protocol::constants::TAXEL_PITCH_MM;
            use gripline_protocol::{ForceMap, LSB_PER_NEWTON, SIDE, TAXELS};

            /// What a map says.
            #[derive(Debug, Clone, Copy, PartialEq, Default)]
            pub struct Sums {
                /// Taxels in contact.
                pub contact: u16,
                /// Taxels in contact that stick.
                pub stick: u16,
                /// Σ fx, Σ fy, Σ fz, newtons.
                pub force_n: [$real; 3],
                /// Σ(x fy − y fx), N·mm.
                pub moment_nmm: $real,
                /// Σ x fz, Σ y fz, N·mm.
                pub pressure_nmm: [$real; 2],
            }

            /// What decides about a taxel.
            #[derive(Debug, Clone, Copy, PartialEq)]
            pub struct Rule {
                /// Friction coefficient.
                pub friction: $real,
                /// Contact above this, newtons.
                pub contact_min_n: $real,
                /// How it is asked.
                pub form: Form,
            }

            /// Newtons of a map of the wire; exact in this type.
            #[must_use]
            pub fn newtons(map: &ForceMap) -> [[$real; 3]; TAXELS] {
                let newton = |step: i16| <$real>::from(step) / LSB_PER_NEWTON as $real;
                map.taxels
                    .map(|force| [newton(force.x), newton(force.y), newton(force.z)])
            }

            /// Whether a taxel is in contact, and whether it sticks.
            #[inline]
            #[must_use]
            pub fn decide([x, y, z]: [$real; 3], rule: Rule) -> (bool, bool) {
                let sticks = match rule.form {
                    Form::Root => (x * x + y * y).sqrt() <= rule.friction * z,
                    Form::Squares => x * x + y * y <= rule.friction * rule.friction * (z * z),
                };
                let contact = z > rule.contact_min_n;
                (contact, contact & sticks)
            }

            impl Sums {
                /// Adds one taxel.
                #[inline]
                pub fn add(&mut self, taxel: usize, force: [$real; 3], rule: Rule) {
                    let centre = (SIDE as $real - 1.0) / 2.0;
                    let pitch_mm = TAXEL_PITCH_MM as $real;
                    let x_mm = ((taxel % SIDE) as $real - centre) * pitch_mm;
                    let y_mm = ((taxel / SIDE) as $real - centre) * pitch_mm;
                    let [x, y, z] = force;
                    let (contact, stick) = decide(force, rule);
                    self.contact += u16::from(contact);
                    self.stick += u16::from(stick);
                    self.force_n[0] += x;
                    self.force_n[1] += y;
                    self.force_n[2] += z;
                    self.moment_nmm += x_mm * y - y_mm * x;
                    self.pressure_nmm[0] += x_mm * z;
                    self.pressure_nmm[1] += y_mm * z;
                }

                /// stick / contact; none without contact.
                #[must_use]
                pub fn stick_ratio(&self) -> Option<$real> {
                    (self.contact > 0).then(|| <$real>::from(self.stick) / <$real>::from(self.contact))
                }
            }

            /// A whole map.
            #[must_use]
            pub fn sums_of(newtons: &[[$real; 3]; TAXELS], rule: Rule) -> Sums {
                let mut sums = Sums::default();
                for (taxel, force) in newtons.iter().enumerate() {
                    sums.add(taxel, *force, rule);
                }
                sums
            }
        }
    };
}

detector!(single, f32, "In f32.");
detector!(double, f64, "In f64.");
