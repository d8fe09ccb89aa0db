//! Count of allocated bytes.

use std::alloc::{GlobalAlloc, Layout, System};
use std::sync::atomic::{AtomicUsize, Ordering};

/// Allocated bytes now, and the largest number since [`begin_count`].
static ALLOCATED: AtomicUsize = AtomicUsize::new(0);
static LARGEST: AtomicUsize = AtomicUsize::new(0);

/// Allocator of the system that counts the bytes of a program. A program declares it as its `global_allocator`.
pub struct CountingAllocator;

fn add(bytes: usize) {
    let now = ALLOCATED.fetch_add(bytes, Ordering::Relaxed) + bytes;
    LARGEST.fetch_max(now, Ordering::Relaxed);
}

#[allow(unsafe_code)] // an allocator cannot be written without; all calls are passed on to that of the system
unsafe impl GlobalAlloc for CountingAllocator {
    unsafe fn alloc(&self, layout: Layout) -> *mut u8 {
        add(layout.size());
        unsafe { System.alloc(layout) }
    }

    unsafe fn alloc_zeroed(&self, layout: Layout) -> *mut u8 {
        add(layout.size());
        unsafe { System.alloc_zeroed(layout) }
    }

    unsafe fn dealloc(&self, pointer: *mut u8, layout: Layout) {
        ALLOCATED.fetch_sub(layout.size(), Ordering::Relaxed);
        unsafe { System.dealloc(pointer, layout) }
    }

    unsafe fn realloc(&self, pointer: *mut u8, layout: Layout, size: usize) -> *mut u8 {
        // The system may need both at once.
        add(size);
        ALLOCATED.fetch_sub(layout.size(), Ordering::Relaxed);
        unsafe { System.realloc(pointer, layout, size) }
    }
}

/// Begins a count; returns the number of bytes that are allocated now.
pub fn begin_count() -> usize {
    let now = ALLOCATED.load(Ordering::Relaxed);
    LARGEST.store(now, Ordering::Relaxed);
    now
}

/// Largest number of bytes that were allocated at once since the count began, beyond those at its beginning.
pub fn largest_since(beginning: usize) -> usize {
    LARGEST.load(Ordering::Relaxed).saturating_sub(beginning)
}
