use gripline_latency::{bound::Walk, image::Image, source::Sources, tables::Left};
fn main() {
    let path = std::env::args().nth(1).unwrap();
    let path = std::path::Path::new(&path);
    let elf = std::fs::read(path).unwrap();
    let image = Image::read(&elf).unwrap();
    let sources = Sources::read(path).unwrap();
    let uart = image.functions_named("USART1").find(|f| f.name.ends_with("USART1") && !f.name.contains("Thunk")).unwrap().clone();

    for part in ["Program<K>::begin", "Head::from_payload"] { dis(&image, part); }
    for left in [Left::Tail, Left::Taxels, Left::Head, Left::Byte, Left::Foreign, Left::Always] {
        let mut walk = Walk::new(&image, &sources, left);
        let c = walk.function(&uart).cycles;
        println!("== {left:?} {c} {:?}", walk.findings);
        let mut parts: Vec<_> = walk.known.iter().map(|(a,b)| (b.cycles, image.functions[a].name.clone())).collect();
        parts.sort(); parts.reverse();
        for ((at,b),k) in &walk.copies { println!("   copy {b} {} {}", k.cycles, image.functions[at].name); }
        for (c,n) in parts.iter().take(14) { println!("   {c} {n}"); }
    }
}
#[allow(dead_code)]
pub fn dis(image: &Image, part: &str) {
    for f in image.functions_named(part) {
        println!("--- {}", f.name);
        let all: Vec<_> = image.instructions.range(f.start..f.end).collect();
        for (i,(at, one)) in all.iter().enumerate() {
            if let gripline_latency::image::Flow::Call(t) = one.flow {
                let name = image.function_at(t).map(|f| f.name.clone()).unwrap_or_default();
                let ctx: Vec<_> = all[i.saturating_sub(4)..i].iter().map(|(_,o)| o.text.clone()).collect();
                println!("{at:#x} call {name}  [{}]", ctx.join("; "));
            }
        }
    }
}
#[allow(dead_code)]
pub fn all(image: &Image, part: &str) {
    for f in image.functions_named(part) {
        println!("--- {}", f.name);
        for (at, one) in image.instructions.range(f.start..f.end) { println!("{at:#x} {}", one.text); }
    }
}
