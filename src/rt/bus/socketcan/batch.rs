//! Several frames in one system call: `recvmmsg` and `sendmmsg`.
//!
//! `nix` has both, over headers that keep pointers and so cannot go with the bus to its thread, and that
//! are not made ready again: after a message without drop counter there is no more room for one.
//! Invariant: the only `unsafe` of the bus; headers live on the stack of one call and point into arguments
//! and locals of that call.

#![expect(unsafe_code, reason = "no safe wrapper of recvmmsg and sendmmsg is Send without the heap")]

use std::os::fd::{AsRawFd, BorrowedFd};

use nix::errno::Errno;
use nix::libc;

use super::layout::Raw;
use crate::base::time::Moment;

/// Most frames of one call: several cycles of three axes.
pub(super) const FRAMES: usize = 16;

/// Room for what the kernel says of a message: stamp and drop counter take 56 bytes.
const CONTROL_WORDS: usize = 8;

/// A received frame and what the kernel said of it.
#[derive(Clone, Copy, Debug)]
pub(super) struct Slot {
    pub(super) raw: Raw,
    /// When it came, on the wall clock.
    pub(super) stamp: Option<Moment>,
    /// Frames that this socket had dropped by then, since it was opened; wraps.
    pub(super) dropped: Option<u32>,
}

impl Slot {
    /// Room for a frame.
    pub(super) const EMPTY: Self = Self { raw: Raw::EMPTY, stamp: None, dropped: None };
}

/// Headers without content.
fn headers() -> [libc::mmsghdr; FRAMES] {
    // SAFETY: structures of numbers and pointers, for which zero is a value; null points nowhere.
    unsafe { std::mem::zeroed() }
}

/// Takes what waits in the socket, oldest first, at most all slots; how many. Never waits.
pub(super) fn receive(socket: BorrowedFd<'_>, slots: &mut [Slot; FRAMES]) -> Result<usize, Errno> {
    let mut vectors = slots.each_mut().map(|slot| libc::iovec {
        iov_base: slot.raw.bytes.as_mut_ptr().cast(),
        iov_len: slot.raw.bytes.len(),
    });
    let mut controls = [[0_u64; CONTROL_WORDS]; FRAMES];
    let mut headers = headers();
    for ((header, vector), control) in headers.iter_mut().zip(&mut vectors).zip(&mut controls) {
        header.msg_hdr.msg_iov = vector;
        header.msg_hdr.msg_iovlen = 1;
        header.msg_hdr.msg_control = control.as_mut_ptr().cast();
        header.msg_hdr.msg_controllen = size_of_val(control) as _;
    }
    // SAFETY: each header points to a vector and a control buffer above, and each vector into its slot.
    // All of them outlive the call and nobody else touches them during it. There is no timeout.
    let count = Errno::result(unsafe {
        libc::recvmmsg(
            socket.as_raw_fd(),
            headers.as_mut_ptr(),
            FRAMES as libc::c_uint,
            libc::MSG_DONTWAIT as _,
            std::ptr::null_mut(),
        )
    })? as usize;
    for (slot, header) in slots.iter_mut().zip(&headers).take(count) {
        slot.raw.length = header.msg_len as usize;
        (slot.stamp, slot.dropped) = said(&header.msg_hdr);
    }
    Ok(count)
}

/// Stamp and drop counter from the control messages of a received message.
fn said(header: &libc::msghdr) -> (Option<Moment>, Option<u32>) {
    let (mut stamp, mut dropped) = (None, None);
    // SAFETY: the header is one that the kernel filled, its control buffer is alive and aligned to 8 bytes.
    let mut next = unsafe { libc::CMSG_FIRSTHDR(header) };
    // SAFETY: null or a control message inside that buffer, written by the kernel.
    while let Some(message) = unsafe { next.as_ref() } {
        // SAFETY: the data of that message is behind it; types are read in the sizes that the kernel writes
        // for them (`put_cmsg` in `net/core/sock.c`), which a cut message does not reach.
        unsafe {
            let data = libc::CMSG_DATA(message);
            let has = |bytes: usize| message.cmsg_len >= libc::CMSG_LEN(bytes as libc::c_uint) as _;
            match (message.cmsg_level, message.cmsg_type) {
                (libc::SOL_SOCKET, libc::SCM_TIMESTAMPNS) if has(size_of::<libc::timespec>()) => {
                    let time = data.cast::<libc::timespec>().read_unaligned();
                    stamp = Some(Moment::ns(time.tv_sec * 1_000_000_000 + time.tv_nsec));
                }
                (libc::SOL_SOCKET, libc::SO_RXQ_OVFL) if has(size_of::<u32>()) => {
                    dropped = Some(data.cast::<u32>().read_unaligned());
                }
                _ => {}
            }
            next = libc::CMSG_NXTHDR(header, message);
        }
    }
    (stamp, dropped)
}

/// Hands frames to the socket, in order, at most [`FRAMES`]; how many it took. The error is that of the first,
/// if it took none. Never waits.
pub(super) fn send(socket: BorrowedFd<'_>, raws: &[Raw]) -> Result<usize, Errno> {
    let mut vectors = [libc::iovec { iov_base: std::ptr::null_mut(), iov_len: 0 }; FRAMES];
    let mut headers = headers();
    for ((header, vector), raw) in headers.iter_mut().zip(&mut vectors).zip(raws) {
        vector.iov_base = raw.bytes.as_ptr().cast_mut().cast();
        vector.iov_len = raw.length.min(raw.bytes.len());
        header.msg_hdr.msg_iov = vector;
        header.msg_hdr.msg_iovlen = 1;
    }
    let count = raws.len().min(FRAMES);
    // SAFETY: each of the `count` headers points to a vector above, and that to a frame of `raws`, which
    // the kernel only reads. All of them outlive the call.
    let sent = Errno::result(unsafe {
        libc::sendmmsg(
            socket.as_raw_fd(),
            headers.as_mut_ptr(),
            count as libc::c_uint,
            libc::MSG_DONTWAIT as _,
        )
    })?;
    Ok(sent as usize)
}
