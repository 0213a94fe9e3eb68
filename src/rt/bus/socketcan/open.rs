//! Opening a CAN interface: every option of the socket, and what to do when it cannot be had.
//!
//! Runs once, before the cycle. An interface is set up by its administrator, see `docs/can.md`; nothing
//! here changes it.
//! Invariant: a socket that was opened is bound, up, filtered, and large enough for the machine's frames.

use std::io;
use std::os::fd::OwnedFd;

use nix::errno::Errno;
use nix::libc;
use nix::net::if_::if_nametoindex;
use nix::sys::socket::{AddressFamily, SockFlag, SockProtocol, SockType, socket};
use socketcan::{CanAddr, CanSocket, Socket, SocketOptions};

use super::layout::FD_BYTES;
use crate::rt::bus::Id;

/// Reports of the own controller that are asked for (`linux/can/error.h`): time-out of the driver, state of
/// the controller, missing acknowledge, bus-off, bus error, restarted.
const REPORTS: u32 = 0x001 | 0x004 | 0x020 | 0x040 | 0x080 | 0x100;

/// Room for received frames that is asked for, in bytes: over two thousand frames. The default holds less than
/// 300 and drops the rest.
const RECEIVE_BUFFER_BYTES: libc::c_int = 1 << 20;

/// What to open.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Settings<'a> {
    /// Name of the interface.
    pub interface: &'a str,
    /// Identifiers to be received, at most 512; the kernel keeps all others away.
    pub identifiers: &'a [Id],
    /// Whether there are FD frames among those received or sent.
    pub is_fd: bool,
}

/// Why an interface cannot be used.
#[derive(Debug, thiserror::Error)]
pub enum OpenError {
    /// No CAN at all.
    #[error(
        "this kernel has no CAN sockets, or the service may not use them: load the modules can and can-raw, \
         and name AF_CAN in RestrictAddressFamilies= of the unit"
    )]
    NoCan,
    /// The system keeps the socket from us.
    #[error("this process may not open a CAN socket ({0}): its container or security profile forbids it")]
    Forbidden(Errno),
    /// No such interface.
    #[error("there is no interface {interface}; `ip -brief link` lists those there are")]
    Missing {
        /// Its name.
        interface: String,
    },
    /// An interface of another kind.
    #[error("interface {interface} is not a CAN interface")]
    NotCan {
        /// Its name.
        interface: String,
    },
    /// Not in service.
    #[error("interface {interface} is down; `ip link set {interface} up` starts it")]
    Down {
        /// Its name.
        interface: String,
    },
    /// Carries no FD frames.
    #[error(
        "interface {interface} has MTU {mtu} and carries classic frames only; the machine's need {FD_BYTES}: \
         give a CAN controller `fd on` and its `dbitrate`, a virtual interface `mtu {FD_BYTES}`, while it \
         is down"
    )]
    ClassicOnly {
        /// Its name.
        interface: String,
        /// Largest frame, in bytes.
        mtu: u32,
    },
    /// Reports were to be sent.
    #[error(
        "interface {interface} is not a vcan: reports of its controller cannot be played, so no scenario in which \
         the host's controller fails"
    )]
    HasController {
        /// Its name.
        interface: String,
    },
    /// Anything else.
    #[error("interface {interface}: {attempt}: {cause}")]
    Refused {
        /// Its name.
        interface: String,
        /// What was tried.
        attempt: &'static str,
        /// What the system says.
        #[source]
        cause: io::Error,
    },
}

/// A socket with every option set, bound to its interface.
pub(super) fn open(settings: &Settings<'_>, filters: &[u8]) -> Result<CanSocket, OpenError> {
    // First, because without CAN in the kernel every name of an interface looks merely unknown.
    let socket = CanSocket::from(raw_socket()?);
    let named = || settings.interface.to_owned();
    let refused = |attempt| move |cause: io::Error| OpenError::Refused { interface: named(), attempt, cause };
    set_options(&socket, settings.is_fd).map_err(refused("setting an option of its socket"))?;
    attach(&socket, settings.interface, filters).map_err(|(attempt, errno)| match (attempt, errno) {
        (Attempt::Find, Errno::ENODEV) => OpenError::Missing { interface: named() },
        (Attempt::Bind, Errno::ENODEV) => OpenError::NotCan { interface: named() },
        (attempt, errno) => refused(attempt.name())(errno.into()),
    })?;
    // An interface that is down can be bound; the socket keeps the error.
    let pending = socket.get_socket_option_int(libc::SOL_SOCKET, libc::SO_ERROR);
    match pending.map_err(refused("asking its state"))? {
        0 => {}
        libc::ENETDOWN => return Err(OpenError::Down { interface: named() }),
        other => return Err(refused("binding to it")(io::Error::from_raw_os_error(other))),
    }
    if settings.is_fd {
        let mtu = mtu(settings.interface).map_err(refused("reading its MTU from /sys/class/net"))?;
        if (mtu as usize) < FD_BYTES {
            return Err(OpenError::ClassicOnly { interface: named(), mtu });
        }
    }
    Ok(socket)
}

fn raw_socket() -> Result<OwnedFd, OpenError> {
    let flags = SockFlag::SOCK_CLOEXEC | SockFlag::SOCK_NONBLOCK;
    socket(AddressFamily::Can, SockType::Raw, flags, SockProtocol::CanRaw).map_err(|errno| match errno {
        Errno::EAFNOSUPPORT | Errno::EPROTONOSUPPORT => OpenError::NoCan,
        errno => OpenError::Forbidden(errno),
    })
}

fn set_options(socket: &CanSocket, is_fd: bool) -> io::Result<()> {
    if is_fd {
        socket.set_socket_option_int(libc::SOL_CAN_RAW, libc::CAN_RAW_FD_FRAMES, 1)?;
    }
    socket.set_error_filter(REPORTS)?;
    socket.set_recv_own_msgs(false)?;
    socket.set_recv_timestamp(true)?;
    socket.set_socket_option_int(libc::SOL_SOCKET, libc::SO_RXQ_OVFL, 1)?;
    let resize = |option| socket.set_socket_option_int(libc::SOL_SOCKET, option, RECEIVE_BUFFER_BYTES);
    // Beyond `net.core.rmem_max` only with CAP_NET_ADMIN; without it up to there.
    resize(libc::SO_RCVBUFFORCE).or_else(|_unprivileged| resize(libc::SO_RCVBUF))
}

/// What was tried of [`attach`].
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum Attempt {
    Find,
    Filter,
    Bind,
}

impl Attempt {
    const fn name(self) -> &'static str {
        match self {
            Self::Find => "looking it up",
            Self::Filter => "setting its filters",
            Self::Bind => "binding to it",
        }
    }
}

/// Binds a socket to the interface of this name. Allocates nothing, so that a bus can be attached again while the
/// cycle runs. Filters and binding take the kernel's lock of its network configuration, and wait for whoever
/// adds or removes interfaces meanwhile.
pub(super) fn attach(socket: &CanSocket, interface: &str, filters: &[u8]) -> Result<(), (Attempt, Errno)> {
    let errno = |cause: io::Error| cause.raw_os_error().map_or(Errno::UnknownErrno, Errno::from_raw);
    let index = if_nametoindex(interface).map_err(|errno| (Attempt::Find, errno))?;
    // Before it is bound, or the first frames would pass unfiltered. The kernel forgets them with a
    // removed interface.
    socket
        .set_socket_option_bytes(libc::SOL_CAN_RAW, libc::CAN_RAW_FILTER, filters)
        .map_err(|cause| (Attempt::Filter, errno(cause)))?;
    let address = CanAddr::new(index);
    socket.as_raw_socket().bind(&address.into()).map_err(|cause| (Attempt::Bind, errno(cause)))
}

/// Whether the interface of this name, with its place in `/sys/class/net`, is a virtual one without controller.
/// Only a `vcan` by name and place is taken for virtual: an adapter on a serial line (slcan) has no device
/// either, and one that does not exist may come back with a machine behind it.
pub fn is_virtual(place: &std::path::Path, name: &str) -> bool {
    let place = place.canonicalize().unwrap_or_default();
    let mut steps = place.components().map(|step| step.as_os_str());
    name.starts_with("vcan")
        && steps.any(|step| step == "devices")
        && steps.next().is_some_and(|step| step == "virtual")
}

/// Largest frame of an interface, in bytes.
fn mtu(interface: &str) -> io::Result<u32> {
    let path = std::path::Path::new("/sys/class/net").join(interface).join("mtu");
    std::fs::read_to_string(path)?
        .trim()
        .parse()
        .map_err(|cause| io::Error::new(io::ErrorKind::InvalidData, cause))
}
