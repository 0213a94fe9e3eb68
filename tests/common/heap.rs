//! Counts what a thread takes from the heap and gives back to it.

#![expect(unsafe_code, reason = "an allocator is unsafe to implement; all of it is handed to the system's")]

use std::alloc::{GlobalAlloc, Layout, System};
use std::cell::Cell;

struct Counting;

thread_local! {
    // Constant and without a destructor, so that reading it allocates nothing.
    static TOUCHED: Cell<u64> = const { Cell::new(0) };
}

fn count() {
    // The allocator outlives the thread's locals; what comes after them is not ours.
    let _gone = TOUCHED.try_with(|touched| touched.set(touched.get() + 1));
}

// SAFETY: every call goes to `System` unchanged.
unsafe impl GlobalAlloc for Counting {
    unsafe fn alloc(&self, layout: Layout) -> *mut u8 {
        count();
        unsafe { System.alloc(layout) }
    }
    unsafe fn dealloc(&self, pointer: *mut u8, layout: Layout) {
        count();
        unsafe { System.dealloc(pointer, layout) }
    }
    unsafe fn realloc(&self, pointer: *mut u8, layout: Layout, size: usize) -> *mut u8 {
        count();
        unsafe { System.realloc(pointer, layout, size) }
    }
}

#[global_allocator]
static ALLOCATOR: Counting = Counting;

/// How often this thread allocated or freed, since it began.
pub(crate) fn touched() -> u64 {
    TOUCHED.get()
}

#[test]
fn the_guard_sees_one_allocation() {
    let before = touched();
    let boxed = std::hint::black_box(Box::new(7_u64));
    assert_eq!(touched() - before, 1);
    drop(boxed);
    assert_eq!(touched() - before, 2);
}
