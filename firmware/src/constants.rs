//! Numbers of the detector, the controller and the safety rules that are not settings: unit, value, reason.

/// Maps in the trend's window: at 60 maps a second 130 ms, about the human reaction time.
pub const TREND_MAPS: usize = 8;
/// Longest time to slip that is reported, ms; a slower fall of the stick ratio is no trend.
pub const TIME_TO_SLIP_MAX_MS: u32 = 10_000;
/// A load falls when it is below its recent peak by more than one part in this: twice the fluctuation of sliding.
pub const FALL_PART: u32 = 22;
/// Part of the threshold on the stick ratio below which the contact slips though its load is within what friction, as the last slide
/// showed it, holds: friction has changed. Chosen on `evaluate paper --data tuning`; with three quarters of the threshold, ratios under a
/// friction higher than the detector's were believed too early (a perfect sensor's precision was 88 instead of 93 %).
pub const CHANGED_PART: u16 = 4;
/// Decay time of a load's recent peak, as a shift of µs: 2¹⁶ µs, half the time a hand takes to let go.
pub const PEAK_SHIFT: u32 = 16;
/// Distance of a load from its centre at which half of a round contact slips, over friction's bound and in 64ths: 0.646 between
/// spheres, 1 − 0.5^{3/2}, times 22/21, because what slid is noted when a part of it is gone. This and the next five were
/// chosen on `evaluate paper --data tuning`.
pub const HALF_ROUND_64THS: u8 = 43;
/// The same of a line, whose contact grows as the square root of its force: 1 − 0.5².
pub const HALF_LINE_64THS: u8 = 49;
/// The same of a flat contact, which hardly grows.
pub const HALF_FLAT_64THS: u8 = 58;
/// The centre over the load that slid and that distance together, in 64ths: what slid is 22/21 of the distance from its centre.
pub const CENTRE_AND_HALF_64THS: i32 = 66;
/// Mean RMS radius of the pressure while the force grew, over the final one, in 64ths, above which a contact is not round: for
/// spheres and ellipsoids theory gives 0.6, and maps 0.57 to 0.65; those of a line and of a flat end hardly grow, 0.72 to 0.93 in
/// maps.
pub const FLAT_64THS: u64 = 45;
/// The value for a contact whose beginning was not seen: that of a round one.
pub const ROUND_64THS: u64 = 41;
/// Square of the RMS radius over the contact's area, in 16ths of its unit per taxel, from which a contact that is not round is a
/// line: in maps round ones have 8 to 9, flat ends 8 to 10, lines 10½ and more.
pub const LINE_16THS: u32 = 10;
/// Friction below which the feed-forward stops growing, 1/10000: at 0.05 it already asks for 20 times the shear.
pub const FEED_FORWARD_FRICTION_MIN: u32 = 500;
/// How far ahead the grip extrapolates the first load, µs: the best of 60 grasps of `evaluate grasps --seed 9`. A longer lead
/// grips harder and learns less friction; a shorter one lets fast loads slide.
pub const LEAD_US: u64 = 20_000;
/// The same once the load has settled and friction is proven, µs: about the gripper's lag.
pub const REST_LEAD_US: u64 = 60_000;
/// Typical friction, assumed until the load settles, 1/10000. A lower value grips harder than needed before the load proves
/// friction; a higher one lets contacts of lower friction slide far.
pub const EXPECTED_FRICTION: u16 = 7_000;
/// How long proven friction counts in full, µs.
pub const PROVEN_US: u32 = 4_000_000;
/// From then on, a part in [`FORGOTTEN_PART`] of it is forgotten in this time, µs: 2 % a second.
pub const FORGETTING_US: u32 = 250_000;
/// See [`FORGETTING_US`].
pub const FORGOTTEN_PART: u16 = 200;
/// Share of the most that a contact has proven that is not forgotten, 1/10000. With 1, this share and 0.7, friction that falls to 65 % of itself
/// in 20 s, and by a fifth where it slides, dropped 23, 1 and 1 of 40 objects (more of those of `friction_that_fades_slowly_drops_nothing`); in a
/// quiet minute the median margin is 57, 95 and 114 % (`evaluate grasps --contact brush --grasps 60 --hold 60`).
pub const REMEMBERED_SHARE: u16 = 8_000;
/// A load has settled after this many maps in a row in which it grew by less than a sixteenth.
pub const REST_MAPS: u8 = 4;
/// Minimum load that can settle, 1/4096 N: 0.25 N.
pub const REST_LOAD_MIN: i32 = 1_024;
/// Normal force below which shear proves no friction, 1/4096 N: 0.73 N.
pub const PROOF_NORMAL_MIN: i32 = 3_000;
/// Stick ratio below which a contact may slide as a whole, 1/10000, and how many such maps in a row, at 7/8 and more of the
/// load that friction was proven by, are a slide: 50 ms at 60 maps a second.
pub const SLIDE_STICK_RATIO: u16 = 3_000;
/// Maps in a row that are a slide; see [`SLIDE_STICK_RATIO`].
pub const SLIDE_MAPS: u8 = 3;
/// Before the load first settles: stick ratio below which the contact may slide if the load over the normal force grew by less
/// than a sixteenth in two maps, 1/10000. A small contact of low friction still sticks by half when it slides. It cuts the
/// slide in the take-up from 0.8 to 0.5 mm at friction 0.5 (`evaluate grasps --seed 12`).
pub const STALL_STICK_RATIO: u16 = 6_000;
/// Minimum load over normal force for that rule, 1/10000.
pub const STALL_RATIO_MIN: u16 = 3_000;
/// Before the load first settles: stick ratio below which the contact may slide although the load over the normal force still grows,
/// 1/10000. Then the line does not fall by plan. Of 1,000 nominal grasps (`evaluate grasps`) five fell there while the object slid.
pub const FIRST_LOAD_STICK_RATIO: u16 = 4_000;
/// Load over normal force up to which such maps surely show a slide, 1/10000, so that two of them are enough: it is near the
/// detector's friction. Above it hardly a taxel sticks by the detector's friction, whether the contact slides or not.
pub const SLIDE_RATIO_SURE: u16 = 6_000;
/// Maps in a row that are a sure slide; see [`SLIDE_RATIO_SURE`].
pub const SLIDE_SURE_MAPS: u8 = 2;
/// Shortest time between maps that the witness of unrest compares, µs: at 60 maps a second every one, at a thousand every tenth.
pub const UNREST_SAMPLE_US: u32 = 10_000;
/// Averaging time of the unrest, as a shift of µs: 0.26 s. This and the next two were chosen on the three uSkin trials with labels.
pub const UNREST_SHIFT: u32 = 18;
/// Averaging time of the usual unrest, as a shift of µs: 1.0 s.
pub const USUAL_UNREST_SHIFT: u32 = 20;
/// The same in the first second of a contact: 0.5 s.
pub const NEW_UNREST_SHIFT: u32 = 19;
/// Assumed usual unrest at the start of a contact, as a logarithm to base 2 of 2⁻²⁴, in 2⁻¹⁶: 0.02 of the RMS radius, from the
/// noise of the shipped network.
pub const USUAL_UNREST: i32 = 1_202_979;
/// Evidence of unrest or motion alone from which the line no longer falls, 1/10000: as likely as not.
pub const FALL_EVIDENCE_MAX: u16 = 5_000;
/// Length of a slot, over which the slide witness averages maps, µs: one map at 60 maps a second.
pub const SLOT_US: u32 = 14_000;
/// Minimum load for the slide witness, 1/4096 N: 0.05 N.
pub const WITNESSED_LOAD_MIN: i32 = 200;
/// Minimum load over normal force for the slide witness, 1/10000: sliding friction of 0.12, seen with gains that are wrong by a
/// quarter on both axes.
pub const SLIDING_RATIO_MIN: u16 = 700;
/// Load over normal force below which shear that follows the grip is no slide, 1/10000. The network's shear error grows with the
/// normal force by up to 7 % of it, and follows the grip like a slide of that friction.
pub const SLIDING_FRICTION_MIN: u16 = 1_200;
/// Part of the normal force by which the shear of a map may err: a 128th, four times the shipped network's noise from picture to
/// picture; that of many maps by half of it.
pub const SHEAR_ERROR_PART: i32 = 128;
/// Most of a change of the normal force that a map shows as shear, share in 1/1024: 7 %.
pub const SHEAR_LEAK_SHARE: i32 = 72;
/// Suspect fall of the shear below the remembered load, share in 1/1024: 7 %. With 6 % a usual grasp is tested more often and held more
/// firmly; with 9 % slides are found later (`evaluate grasps`, both worlds).
pub const DROP_SHARE: i32 = 72;
/// The same while the shear does not fluctuate: 3 %; three times its noise is added. Finds slow slides sooner;
/// nominal grasps are held no more firmly (`evaluate grasps`).
pub const QUIET_DROP_SHARE: i32 = 30;
/// The same in one slot: 11 %.
pub const SUDDEN_DROP_SHARE: i32 = 112;
/// Least part of it that must have come within three slots, share in 1/1024: 2.4 %. A load that an arm takes off falls more slowly.
pub const RECENT_FALL_SHARE: i32 = 25;
/// Noise of a load above which it counts as a change, share in 1/1024: 8 %.
pub const NOISE_MAX: i32 = 82;
/// Share by which the shear may stay below the load for long, in 1/1024: 1 % without noise, at most 4 %.
pub const SHORT_SHARE_MIN: i32 = 12;
/// Its maximum; see [`SHORT_SHARE_MIN`].
pub const SHORT_SHARE_MAX: i32 = 41;
/// Time below the load after which the shear is suspect, µs.
pub const SHORT_US: u32 = 150_000;
/// Time without growth after which a load has settled for the slide witness, µs: five slots.
pub const SETTLED_US: u32 = 80_000;
/// Time without growth of the load over normal force after which a contact that has never slid may slide, µs: three slots. A contact that
/// slides carries more only as its grip grows.
pub const STALLED_US: u32 = 45_000;
/// Time for which a new contact carries a load until that is tested, µs. Only then may the line fall.
pub const UNTRIED_US: u32 = 300_000;
/// Stick ratio below which a contact carries more than the detector's friction, 1/10000: one that slides at less sticks as a whole
/// by that friction, apart from the noise of its edge. Chosen on `evaluate grasps`, where 0.63 and 0.85 do as well.
pub const WHOLE_STICK_RATIO: u16 = 7_000;
/// Fall of the shear below the load that is news also right after a test that found the contact held, share in 1/1024: an eighth.
pub const NEWS_SHARE: i32 = 128;
/// Part of a load that may have moved to another finger that is held beyond it: the grip under which it moved let the contact slide. Of 120
/// grasps in a world that is not kept, whose finger with the sensor got wet, 23 were dropped without it and 19 with it, as with a quarter.
pub const MOVED_LOAD_PART: i32 = 8;
/// A load that suddenly falls below one part in this is gone, not moved: water and sliding leave no less of a finger's friction.
pub const GONE_LOAD_PART: i32 = 5;
/// A load that had sunk by the second of these shares and comes within the first of what it was, before the grip has risen, is held: no slide
/// carries more for the same normal force. In 1/1024: 5 and 9 %.
pub const BACK_SHARE: i32 = 51;
/// See [`BACK_SHARE`].
pub const SUNK_SHARE: i32 = 92;
/// Rise of the normal force in a test after which the shear is evaluated, share in 1/1024: 20 %.
pub const ASKED_SHARE: i32 = 205;
/// Change of the normal force over four slots up to which it counts as constant, share in 1/1024: 2 %.
pub const RISES_SHARE: i32 = 20;
/// Rise of the shear over four slots at a constant normal force that shows a growing load, share in 1/1024: 6 %. What slides carries no
/// more for the same normal force.
pub const GROWN_SHARE: i32 = 61;
/// Share of the assumed friction that one slide may remove before the test has confirmed it, 1/10000.
pub const FRICTION_LOSS_MAX: u16 = 6_000;
/// Share of the proven friction that is kept when the load came back during a test, 1/10000: it may only have swung.
pub const SWING_LOSS_MAX: u16 = 9_000;
/// Fall of the normal force over four slots with which the shear must not have sunk, share in 1/1024: 6 %.
pub const SINK_SHARE: i32 = 61;
/// Slow fall of the normal force with which the shear must not have sunk, share in 1/1024: 3 %.
pub const FADE_SHARE: i32 = 31;
/// Time without any suspicion after which a load that came back is forgotten, µs: what slides does so again as soon as the grip has come
/// back. A held load that wavers does so at the same ratio, too, but later; with 3 s such loads were held ever more firmly
/// (`evaluate grasps --hold 60`).
pub const COME_BACK_US: u32 = 700_000;
/// Slots in a row in which the shear must rise with the normal force, to two fifths, until that is a slide.
pub const FOLLOWED_SLOTS: u8 = 3;
/// Share of the most that a contact has carried in a test, over normal force, that it must still carry where shear follows the grip, in
/// 8ths. Less: the load has swung. With 7½ slides go unfound (`evaluate grasps --world adverse`: 8 more drops of 700), with 6½ shaken
/// objects are held as firmly as without.
pub const SWUNG_8THS: u32 = 7;
/// Fall of the shear in one slot that can be sudden, share of the load in 1/1024: 3 %.
pub const SUDDEN_SHARE: i32 = 32;
/// How long after its end a test's finding of a slide may be taken back, µs: a period of a load that swings at 2 Hz. If none ever is, a load
/// that swings by a fifth at 8 Hz is held with fifteen times the needed force instead of less than six
/// (`a_load_that_swings_is_not_held_ever_more_firmly`).
pub const DOUBTED_US: u32 = 500_000;
/// Longest test without a finding, µs: a gripper with a time constant of 100 ms has risen by then.
pub const UNPROVEN_US_MAX: u32 = 500_000;
/// Load that a test holds before it has a finding, 1/10000 of the load: 1.1.
pub const TEST_MARGIN: u16 = 11_000;
/// Longest test, µs.
pub const TEST_US_MAX: u32 = 1_000_000;
/// Time without another test at the same normal force after a test that found the contact held, µs.
pub const HUSH_HELD_US: u32 = 400_000;
/// Time without another test after any other test, µs.
pub const HUSH_US: u32 = 80_000;
/// Time without any suspicion before the line may fall by plan, µs.
pub const CALM_US: u32 = 160_000;
/// Share of the friction found by a slide that the grip counts on while the host does not see the object, 1/10000: the slower it slid,
/// the more friction falls at speed. Of 1,400 grasps of `evaluate grasps --world adverse` (seeds 2 and 3) 169 were dropped when this was
/// chosen; with 1 it were 212 and 13 % less margin, with 0.75 159 and 10 % more.
pub const FAST_SLIDE_SHARE: u16 = 8_500;
/// How long the host's last clear view of the object counts, µs: thirty pictures.
pub const WATCHED_US: u32 = 500_000;
/// Rise of the line in a test, as a part of the line: a third. With a seventh, slides are found too late: when friction falls from
/// 0.8 to 0.3 the object slides for more than a second.
pub const TEST_RISE_PART: i32 = 3;
/// How far the line goes ahead of the gripper in a test of a shear that falls little by little, share of the line in 8ths. Without a maximum
/// the tests of a load that recedes add up: 24 seeds of `gripline run` then reach 13 to 30 N, with it (and [`SHEAR_LEAK_SHARE`]) 12 to 22,
/// and no more objects of the adverse world are dropped (`evaluate grasps`). With two fifths it is 13 to 20 N; with a third a load of 3 N that
/// swings at 3 Hz brings the line to its ceiling.
pub const SHORT_RISE_8THS: i32 = 3;
/// Minimum rise of a test, 1/4096 N: 1 N, which a gripper with internal friction still follows.
pub const TEST_RISE_MIN: i32 = 4_096;
/// Rate of relaxing below which a grip keeps what a test of a slide added, 1/4096 N per second: 1 N/s. Whoever lets the line fall so slowly
/// wants the reserve.
pub const SLOW_RELAX_RATE: u16 = 4_096;
/// Square by which a map's blur widens a contact, 1/16 of half a pitch squared: 54 for a deviation of 0.65 taxels in both
/// directions, and a third more for the edge that a light touch does not show.
pub const BLUR_MEAN_SQUARE: u16 = 70;
/// Inverse square of a torsional moment's lever over the contact's RMS radius, in 16ths. 18 would hold a contact
/// (`contact_geometry.rs`); maps lose a tenth of a moment.
pub const SEEN_MOMENT: u64 = 22;
/// Part of the shear that maps may show too much of, with the normal force: a fifth, which takes back a quarter too much.
pub const SCALE_ERROR_PART: i32 = 5;
/// How fast the grip closes on an object with hardly any contact force, 1/4096 N per ms: 4 N/s.
pub const SEEK_RATE: i32 = 16;
/// How far above the floor it closes then, 1/4096 N: 1 N, at most the floor.
pub const SEEK_MAX: i32 = 4_096;
/// Assumed time constant of the gripper's force behind its line, as a shift of µs: 66 ms.
pub const GRIPPER_LAG_SHIFT: u32 = 16;
/// Added to a link's CRC-storm level by a broken map, however many of its packets are refused; the level falls by 1 each
/// millisecond. At 60 maps a second one broken map in two is no storm, and five in a row are one.
pub const STORM_PER_MAP: u32 = 36;
/// Added by a refused packet that belongs to no map.
pub const STORM_PER_PACKET: u32 = 10;
/// Level that raises CRC STORM: three broken maps or ten other refused packets at once.
pub const STORM_LEVEL: u32 = 100;
/// Maximum storm level, so that a storm is over 200 ms after the last broken packet.
pub const STORM_LEVEL_MAX: u32 = 200;
/// How far ahead of the promptest map a capture time may be, µs: a late first map does not lock a host out.
pub const FUTURE_MAX_US: i32 = 1_000_000;
/// Tolerated drift between the host's clock and ours, as a shift: 2⁻¹², 244 parts per million, twice that of two crystals. Maps
/// whose delay grows faster than that become stale.
pub const CLOCK_DRIFT_SHIFT: u32 = 12;
/// Maximum tolerated drift over a silence, µs: that of 305 hours; it fits the type of the clocks' difference.
pub const CLOCK_DRIFT_MAX_US: u64 = 1 << 28;
/// How long maps show no contact until a held object counts as lost, µs: six maps at 60 a second; a touch that flickers comes back
/// sooner.
pub const CONTACT_GONE_US: u64 = 100_000;
/// How long a map tells of the present, µs: three maps at 60 a second.
pub const MAP_PRESENT_US: u64 = 50_000;
/// Time between two statuses without a map, ms.
pub const STATUS_PERIOD_MS: u32 = 100;
/// Bound from the last packet in the FIFO to the line written, core cycles: 25 µs at 168 MHz.
pub const DECIDE_BUDGET_CYCLES: u32 = 4_200;

/// Baud rate of the gripper's bus (2F-85 & 2F-140 manual, "Modbus RTU communication", connection setup).
pub const MODBUS_BAUD: u32 = 115_200;
/// The gripper's address on the bus as delivered (same section).
pub const MODBUS_UNIT: u8 = 9;
/// A byte on the bus, µs, rounded up: start bit, eight data bits, stop bit.
pub const MODBUS_BYTE_US: u64 = 10 * 1_000_000 / MODBUS_BAUD as u64 + 1;
/// Silence that ends a frame, µs: 1.75 ms above 19,200 baud (Modbus over serial line V1.02, section 2.5.1.1).
pub const MODBUS_SILENCE_US: u64 = 1_750;
/// Minimum time between the starts of two requests, µs: the gripper's registers change at 200 Hz (manual, note on function code 23:
/// "minimum delay of 5 ms").
pub const MODBUS_SLOT_US: u64 = 5_000;
/// How long sending a request may take, µs: three times its bytes on the wire, and well before its answer counts as lost.
pub const MODBUS_SEND_US: u64 = 5_000;
/// How long an answer may take after the end of its request, µs: several turns of the gripper's own loop.
pub const MODBUS_ANSWER_US: u64 = 25_000;
/// Silence after a lost or damaged answer, µs, so that a late answer is not taken for the next one.
pub const MODBUS_QUIET_US: u64 = 10_000;
/// Requests in a row without a good answer after which the gripper counts as gone: about 0.1 s.
pub const MODBUS_FAILURES_MAX: u8 = 3;

/// First of the three registers that command the gripper (manual, table 4-1 and the examples of section 4.8).
pub const ROBOTIQ_COMMAND: u16 = 0x03E8;
/// First of the three registers with its state (same tables).
pub const ROBOTIQ_STATUS: u16 = 0x07D0;
/// Speed register while closing: about a quarter of the 30 to 250 mm/s, because what hits the object is the moving
/// fingers' momentum as much as the motor's current.
pub const ROBOTIQ_CLOSING_SPEED: u8 = 0x40;
/// Speed register while opening.
pub const ROBOTIQ_OPENING_SPEED: u8 = 0x40;
/// How long the gripper may take to echo a new request, µs: two requests and one lost answer.
pub const ROBOTIQ_ECHO_US: u64 = 100_000;
/// Time between two attempts to activate, µs.
pub const ROBOTIQ_ACTIVATION_PAUSE_US: u64 = 1_000_000;
/// Longest activation, µs: the fingers open and close once in a few seconds; after this it is tried again.
pub const ROBOTIQ_ACTIVATION_MAX_US: u64 = 15_000_000;
