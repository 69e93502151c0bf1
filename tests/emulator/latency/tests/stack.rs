//! The stack of the unmodified image: bounded over the linked code, compared with what the link leaves and with a run.

use gripline_latency::image::Image;
use gripline_latency::source::Sources;
use gripline_latency::stack::{PRIORITIES, Stack};

fn image() -> std::path::PathBuf {
    std::env::var_os("GRIPLINE_IMAGE")
        .expect("GRIPLINE_IMAGE names the image; `cargo xtask test` sets it")
        .into()
}

fn stack() -> Stack {
    let path = image();
    let elf = std::fs::read(&path).expect("the image is there");
    let image = Image::read(&elf).expect("the image is one");
    Stack::of(&image, &Sources::read(&path).expect("it has lines"), &elf).expect("it has a stack")
}

#[test]
#[ignore = "needs the image: cargo xtask test"]
fn all_contexts_nested_fit_the_memory_that_the_link_leaves_for_the_stack() {
    let stack = stack();
    for context in &stack.contexts {
        println!("{:6} {:?} {}", context.bytes, context.priority, context.name);
        for (name, own) in &context.chain {
            println!("         {own:6} {name}");
        }
    }
    println!("bound {} of {} bytes", stack.bound, stack.room());
    assert!(stack.findings.is_empty(), "{:#?}", stack.findings);
    assert!(stack.bound <= stack.room(), "{} of {}", stack.bound, stack.room());
    let handlers = stack.contexts.iter().filter(|context| context.priority.is_some());
    assert_eq!(handlers.count(), PRIORITIES.len());
}

/// The link left more; a stack that is a byte too small for the bound, or a run that goes deeper, is found.
#[test]
#[ignore = "needs the image: cargo xtask test"]
fn a_stack_that_is_too_small_or_a_bound_that_is_wrong_fails_the_check() {
    let stack = stack();
    assert_eq!(stack.failures(stack.bound), [""; 0]);
    let tight = Stack {
        memory: (stack.memory.1 + stack.bound - 1, stack.memory.1),
        ..stack.clone()
    };
    assert!(tight.failures(0)[0].contains(&format!("expected at most {}", stack.bound - 1)));
    assert!(stack.failures(stack.bound + 1)[0].contains("stack of a run"));
}
