//! What `/proc` and `/sys` say about kernel, processors and the bus's interrupt.
//!
//! A file that is not there is no error: it says that the kernel has no such thing.
//! Invariant: only reads; every path is below the root it is given.

use std::collections::BTreeMap;
use std::fs;
use std::ops::RangeInclusive;
use std::path::{Path, PathBuf};

use crate::rt::bus::socketcan::is_virtual;

/// What was found.
#[derive(Clone, Debug, Default, PartialEq, Eq)]
pub struct System {
    /// Release and version of the kernel, as `uname -rv`.
    pub kernel: String,
    /// Whether it is preemptible throughout.
    pub is_preempt_rt: bool,
    /// Processors that run.
    pub online: CpuList,
    /// Processors kept free of other work.
    pub isolated: CpuList,
    /// Processors without a scheduler tick while one thread runs.
    pub nohz_full: CpuList,
    /// Processors whose RCU work others do.
    pub rcu_nocbs: CpuList,
    /// How the frequency of each processor is chosen; empty without frequency scaling.
    pub governors: BTreeMap<u16, String>,
    /// Whether processors enter idle states that take time to leave.
    pub has_idle_states: bool,
    /// The CAN interface, where frames leave this computer.
    pub interface: Option<Interface>,
}

/// A CAN interface.
#[derive(Clone, Debug, Default, PartialEq, Eq)]
pub struct Interface {
    /// Its name.
    pub name: String,
    /// Whether there is one of that name.
    pub is_there: bool,
    /// Whether there is no controller behind it, as behind vcan.
    pub is_virtual: bool,
    /// Threads that handle its controller's interrupts.
    pub interrupts: Vec<InterruptThread>,
}

/// A thread of the kernel that handles an interrupt.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct InterruptThread {
    /// Number of the thread.
    pub pid: u32,
    /// Its name, as `irq/41-can0`.
    pub name: String,
    /// Its priority under SCHED_FIFO.
    pub priority: u8,
}

impl System {
    /// Reads it all; `interface` is the CAN interface, if frames leave this computer.
    pub fn read(root: &Path, interface: Option<&str>) -> Self {
        let cpus = root.join("sys/devices/system/cpu");
        let version = text(&root.join("proc/sys/kernel/version"));
        let nohz_full = CpuList::parse(&text(&cpus.join("nohz_full")));
        let command_line = text(&root.join("proc/cmdline"));
        let driver = text(&cpus.join("cpuidle/current_driver"));
        Self {
            kernel: format!("{} {version}", text(&root.join("proc/sys/kernel/osrelease"))),
            is_preempt_rt: text(&root.join("sys/kernel/realtime")) == "1" || version.contains("PREEMPT_RT"),
            online: CpuList::parse(&text(&cpus.join("online"))),
            isolated: CpuList::parse(&text(&cpus.join("isolated"))),
            rcu_nocbs: CpuList::of_rcu(&command_line).or(&nohz_full),
            nohz_full,
            governors: governors(&cpus),
            has_idle_states: !driver.is_empty() && driver != "none",
            interface: interface.map(|name| Interface::read(root, name)),
        }
    }
}

/// A file without the white space around it; nothing where there is none.
fn text(path: &Path) -> String {
    fs::read_to_string(path).unwrap_or_default().trim().to_owned()
}

/// Names in a folder; none where there is none.
fn names(folder: &Path) -> Vec<String> {
    let entries = fs::read_dir(folder).into_iter().flatten().flatten();
    entries.filter_map(|entry| entry.file_name().into_string().ok()).collect()
}

fn governors(cpus: &Path) -> BTreeMap<u16, String> {
    let governor = |name: String| {
        let cpu = name.strip_prefix("cpu")?.parse().ok()?;
        let governor = text(&cpus.join(name).join("cpufreq/scaling_governor"));
        (!governor.is_empty()).then_some((cpu, governor))
    };
    names(cpus).into_iter().filter_map(governor).collect()
}

/// Processors as the kernel lists them: `0-2,5`.
#[derive(Clone, Debug, Default, PartialEq, Eq)]
pub struct CpuList(Vec<RangeInclusive<u16>>);

impl CpuList {
    /// Reads a list; what is no number in it (`domain`, `(null)`) names no processor.
    fn parse(list: &str) -> Self {
        let range = |part: &str| {
            let (first, last) = part.split_once('-').unwrap_or((part, part));
            Some(first.trim().parse().ok()?..=last.trim().parse().ok()?)
        };
        Self(list.split(',').filter_map(range).collect())
    }

    /// The list behind `rcu_nocbs` on the kernel's command line; alone it means all.
    fn of_rcu(command_line: &str) -> Self {
        let all = || Self(vec![0..=u16::MAX]);
        let list = |word: &str| match word.strip_prefix("rcu_nocbs")? {
            "" | "=all" => Some(all()),
            list => list.strip_prefix('=').map(Self::parse),
        };
        command_line.split_whitespace().find_map(list).unwrap_or_default()
    }

    fn or(mut self, other: &Self) -> Self {
        self.0.extend_from_slice(&other.0);
        self
    }

    /// Whether a processor is in it.
    pub fn has(&self, cpu: u16) -> bool {
        self.0.iter().any(|range| range.contains(&cpu))
    }
}

impl Interface {
    fn read(root: &Path, name: &str) -> Self {
        let device = root.join("sys/class/net").join(name);
        let of_device = device_interrupts(&device);
        let mut interrupts = interrupt_threads(root);
        interrupts.retain(|thread| is_of(thread, name, &of_device));
        let is_there = device.exists();
        Self { name: name.to_owned(), is_there, is_virtual: is_virtual(&device, name), interrupts }
    }
}

/// What the threads of a controller's interrupts are called by: numbers, and names.
struct DeviceInterrupts {
    numbers: Vec<String>,
    device_name: Option<String>,
}

fn device_interrupts(device: &Path) -> DeviceInterrupts {
    let behind: PathBuf = device.join("device");
    let mut numbers = names(&behind.join("msi_irqs"));
    numbers.push(text(&behind.join("irq")));
    let target = behind.canonicalize().ok();
    let device_name = target.and_then(|path| Some(path.file_name()?.to_str()?.to_owned()));
    DeviceInterrupts { numbers, device_name }
}

fn is_of(thread: &InterruptThread, interface: &str, device: &DeviceInterrupts) -> bool {
    let Some((number, handler)) = thread.name.trim_start_matches("irq/").split_once('-') else {
        return false;
    };
    device.numbers.iter().any(|own| own == number)
        || handler == interface
        || device.device_name.as_deref() == Some(handler)
}

fn interrupt_threads(root: &Path) -> Vec<InterruptThread> {
    let processes = root.join("proc");
    let thread = |pid: String| {
        let name = text(&processes.join(&pid).join("comm"));
        if !name.starts_with("irq/") {
            return None;
        }
        let priority = priority(&text(&processes.join(&pid).join("stat")))?;
        Some(InterruptThread { pid: pid.parse().ok()?, name, priority })
    };
    names(&processes).into_iter().filter_map(thread).collect()
}

/// Real-time priority in the text of `/proc/PID/stat`: field 40, proc(5). The name in field 2 may hold
/// spaces, so fields are counted from behind it.
fn priority(stat: &str) -> Option<u8> {
    let (_, rest) = stat.rsplit_once(')')?;
    rest.split_whitespace().nth(40 - 3)?.parse().ok()
}

#[cfg(test)]
mod tests {
    use super::*;
    use std::os::unix::fs::symlink;

    /// A tree of files, as `/proc` and `/sys` are.
    fn tree(files: &[(&str, &str)]) -> tempfile::TempDir {
        let root = tempfile::tempdir().unwrap();
        for (path, text) in files {
            let path = root.path().join(path);
            fs::create_dir_all(path.parent().unwrap()).unwrap();
            fs::write(path, text).unwrap();
        }
        root
    }

    #[test]
    fn a_prepared_machine_is_read_in_full() {
        let root = tree(&[
            ("proc/sys/kernel/osrelease", "6.1.0-56-rt-amd64\n"),
            ("proc/sys/kernel/version", "#1 SMP PREEMPT_RT Debian 6.1.192-2\n"),
            ("proc/cmdline", "quiet isolcpus=domain,3 rcu_nocbs=2-3 splash\n"),
            ("sys/devices/system/cpu/online", "0-3\n"),
            ("sys/devices/system/cpu/isolated", "3\n"),
            ("sys/devices/system/cpu/nohz_full", "(null)\n"),
            ("sys/devices/system/cpu/cpuidle/current_driver", "intel_idle\n"),
            ("sys/devices/system/cpu/cpu0/cpufreq/scaling_governor", "powersave\n"),
            ("sys/devices/system/cpu/cpu3/cpufreq/scaling_governor", "performance\n"),
            ("sys/devices/system/cpu/cpufreq/boost", "1\n"),
        ]);
        let system = System::read(root.path(), None);
        assert!(system.is_preempt_rt && system.has_idle_states);
        assert_eq!(system.kernel, "6.1.0-56-rt-amd64 #1 SMP PREEMPT_RT Debian 6.1.192-2");
        let lists = [&system.online, &system.isolated, &system.nohz_full, &system.rcu_nocbs];
        assert_eq!(lists.map(|list| list.has(3)), [true, true, false, true]);
        assert_eq!(lists.map(|list| list.has(1)), [true, false, false, false]);
        let governors = [(0, "powersave".to_owned()), (3, "performance".to_owned())];
        assert_eq!(system.governors, governors.into());
    }

    #[test]
    fn an_empty_tree_has_nothing() {
        let root = tree(&[]);
        assert_eq!(System::read(root.path(), None), System { kernel: " ".to_owned(), ..System::default() });
    }

    #[test]
    fn a_kernel_of_old_says_real_time_in_a_file() {
        let version = ("proc/sys/kernel/version", "#1 SMP PREEMPT RT");
        assert!(!System::read(tree(&[version]).path(), None).is_preempt_rt);
        let file = ("sys/kernel/realtime", "1\n");
        assert!(System::read(tree(&[version, file]).path(), None).is_preempt_rt);
    }

    #[test]
    fn lists_of_processors() {
        let all = |list: &str| (0..8).filter(|cpu| CpuList::parse(list).has(*cpu)).collect::<Vec<_>>();
        assert_eq!(all("0-2,5"), [0, 1, 2, 5]);
        assert_eq!(all(" 7 "), [7]);
        assert_eq!(all(""), [] as [u16; 0]);
        assert_eq!(all("x-3,-,4-"), [] as [u16; 0]);
        assert!(CpuList::of_rcu("rcu_nocbs").has(9) && CpuList::of_rcu("a rcu_nocbs=all").has(9));
        assert!(!CpuList::of_rcu("rcu_nocbs_poll").has(0) && !CpuList::of_rcu("").has(0));
        assert!(CpuList::of_rcu("").or(&CpuList::parse("4")).has(4), "nohz_full brings it along");
    }

    #[test]
    fn only_a_vcan_is_virtual() {
        let root = tree(&[
            ("sys/devices/virtual/net/vcan0/mtu", "72"),
            ("sys/devices/virtual/net/slcan0/mtu", "16"),
            ("sys/devices/pci0000:00/0000:00:05.0/net/can0/mtu", "72"),
            ("sys/class/net/bonding_masters", ""),
        ]);
        let net = root.path().join("sys/class/net");
        symlink("../../devices/virtual/net/vcan0", net.join("vcan0")).unwrap();
        symlink("../../devices/virtual/net/slcan0", net.join("slcan0")).unwrap();
        symlink("../../devices/pci0000:00/0000:00:05.0/net/can0", net.join("can0")).unwrap();
        let read = |name| System::read(root.path(), Some(name)).interface.unwrap();
        let kind = |name| (read(name).is_there, read(name).is_virtual);
        assert_eq!(["vcan0", "can0", "can7"].map(kind), [(true, true), (true, false), (false, false)]);
        assert_eq!(kind("slcan0"), (true, false), "a machine may be at the end of a serial line");
    }

    #[test]
    fn the_threads_of_the_controllers_interrupt_are_found() {
        let stat = |name: &str, priority: u8| {
            format!("41 ({name}) S 2 0 0 0 -1 2129984 {}{priority} 1 0", "0 ".repeat(30))
        };
        let [by_name, by_number, of_spi] =
            [("irq/41-can0", 50), ("irq/27-pciefd", 51), ("irq/9-spi0.0", 90)].map(|(n, p)| stat(n, p));
        let root = tree(&[
            ("proc/141/comm", "irq/41-can0\n"),
            ("proc/141/stat", &by_name),
            ("proc/127/comm", "irq/27-pciefd\n"),
            ("proc/127/stat", &by_number),
            ("proc/109/comm", "irq/9-spi0.0\n"),
            ("proc/109/stat", &of_spi),
            ("proc/200/comm", "quadrantd\n"),
            ("proc/200/stat", &by_name),
            ("sys/devices/pci0/net/can0/mtu", "72"),
            ("sys/devices/pci0/irq", "0\n"),
            ("sys/devices/pci0/msi_irqs/27", "msi\n"),
            ("sys/devices/spi0.0/net/can1/mtu", "72"),
            ("sys/class/net/bonding_masters", ""),
        ]);
        let net = root.path().join("sys/class/net");
        for (device, name) in [("pci0", "can0"), ("spi0.0", "can1")] {
            symlink(format!("../../devices/{device}/net/{name}"), net.join(name)).unwrap();
            let folder = root.path().join(format!("sys/devices/{device}/net/{name}"));
            symlink("../..", folder.join("device")).unwrap();
        }
        let found = |name: &str| {
            let mut threads = System::read(root.path(), Some(name)).interface.unwrap().interrupts;
            threads.sort_by_key(|thread| thread.pid);
            threads.into_iter().map(|thread| (thread.pid, thread.priority)).collect::<Vec<_>>()
        };
        assert_eq!(found("can0"), [(127, 51), (141, 50)]);
        assert_eq!(found("can1"), [(109, 90)]);
        assert_eq!(found("can2"), []);
    }
}
