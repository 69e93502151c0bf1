//! Prints the figures.
use gripline_emulator::Board;
use gripline_emulator::usb::{Cable, UsbState};
use gripline_latency::image::Image;
use gripline_latency::walk::{Step, Walk};
use gripline_protocol::message::{Command, Hello, Message, MessagePackets};
use gripline_protocol::{ForceMap, MapInfo, TaxelForce, encode_map};
use std::collections::BTreeMap;

fn main() {
    let elf = std::fs::read(std::env::args().nth(1).unwrap()).unwrap();
    let image = Image::read(&elf).unwrap();
    println!(
        "{} instructions, {} functions, flash {} ram {}",
        image.instructions.len(),
        image.functions.len(),
        image.flash_bytes,
        image.ram_bytes
    );
    let addresses: Vec<u32> = image.instructions.keys().copied().collect();
    let t = std::time::Instant::now();
    let mut board = Board::boot_traced(&elf, &addresses).unwrap();
    board.usb_cable(Cable::In);
    let mut walk = Walk::new(&image);
    let mut n = 0u64;
    while board.usb_state() != UsbState::Configured {
        board.run_for(1_000_000).unwrap();
        let tr = board.take_trace();
        walk.take(&tr, |_| n += 1);
    }
    eprintln!(
        "configured at {} ns, {n} instructions traced of {}, {:?} depth {}",
        board.now_ns(),
        board.instructions(),
        t.elapsed(),
        walk.depth()
    );
    let mut id = 0;
    let mut say = |board: &mut Board, m: Message| {
        id += 1;
        let mut p = MessagePackets::new(&m, id).unwrap();
        let mut b = [0; 64];
        while let Some(l) = p.next_packet(&mut b) {
            board.usb_send(&b[..l]);
        }
    };
    say(&mut board, Message::Hello(Hello::of_this_build(0, 1)));
    say(&mut board, Message::Command(Command::Hold));
    board.run_for(20_000_000).unwrap();
    let tr = board.take_trace();
    walk.take(&tr, |_| n += 1);
    let contacts: usize = std::env::args().nth(2).map_or(400, |s| s.parse().unwrap());
    for sequence in 1..=12u32 {
        let mut map = ForceMap::EMPTY;
        for t in map.taxels.iter_mut().take(contacts) {
            *t = TaxelForce {
                x: 90,
                y: -40,
                z: 700,
            };
        }
        encode_map(
            &MapInfo {
                sequence,
                capture_us: sequence * 16667,
                ..MapInfo::default()
            },
            &map,
            |p| board.usb_send(p),
        );
        board.run_for(10_000_000).unwrap();
        let tr = board.take_trace();
        let mut steps: Vec<Step> = Vec::new();
        walk.take(&tr, |s| steps.push(s));
        // windows from delivery to DAC
        let mut open: Option<(usize, u64, usize)> = None;
        let mut by: BTreeMap<String, (u32, u32)> = BTreeMap::new();
        let mut windows = Vec::new();
        for (i, s) in steps.iter().enumerate() {
            if s.deliveries > 0 {
                open = Some((i, 0, 0));
                by.clear();
            }
            if let Some((_, c, k)) = &mut open {
                *c += u64::from(s.cycles);
                *k += 1;
                let name = image
                    .function_at(s.instruction.address)
                    .map_or("?".into(), |f| f.name.clone());
                let e = by.entry(name).or_default();
                e.0 += 1;
                e.1 += s.cycles;
                let reg = std::env::args()
                    .nth(3)
                    .and_then(|s| u32::from_str_radix(&s, 16).ok())
                    .unwrap_or(0x4000_7408);
                if s.access == Some(reg) {
                    windows.push((*k, *c));
                    if *k > 2450 && *k < 4000 {
                        let mut v: Vec<_> = by.iter().collect();
                        v.sort_by_key(|x| std::cmp::Reverse(x.1.1));
                        println!("window {k}");
                        for (n, (i, c)) in v {
                            println!("{i:6} {c:6} {n}");
                        }
                    }
                    open = None;
                }
            }
        }
        println!("map {sequence}: {windows:?}");
        if sequence == 12 {
            let mut v: Vec<_> = by.iter().collect();
            v.sort_by_key(|x| std::cmp::Reverse(x.1.1));
            for (n, (i, c)) in v {
                println!("{i:6} {c:6} {n}");
            }
            if let Some(f) = std::env::args().nth(4) {
                let mut o = String::new();
                for s in &steps {
                    o += &format!(
                        "{:08x} {} {:?} {} {}\n",
                        s.instruction.address,
                        s.instruction.text,
                        s.access,
                        s.cycles,
                        image.function_at(s.instruction.address).map_or("?", |f| &f.name)
                    );
                }
                std::fs::write(f, o).unwrap();
            }
        }
    }
    eprintln!("{:?}", t.elapsed());
}
