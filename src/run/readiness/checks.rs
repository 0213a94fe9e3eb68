//! The checks one by one: what was obtained against what is wanted, and what mends it.
//!
//! Invariant: each function judges one thing, and its `mend` names what a person has to change.

use std::ops::Range;

use nix::errno::Errno;

use super::system::{Interface, System};
use super::{Check, State};
use crate::base::time::Span;
use crate::rt::thread::rehearsal::Rehearsal;
use crate::rt::thread::{LockRefusal, Memory, PageFaults, Policy, Settings, Thread};

/// What was obtained and found.
#[derive(Clone, Copy, Debug)]
pub struct Obtained<'o> {
    /// Heap and locked pages.
    pub memory: Memory,
    /// Exit latency that idle states may have, us, or why there is no bound.
    pub awake: Result<i32, Errno>,
    /// Scheduling of the cycle's thread.
    pub thread: &'o Thread,
    /// What the rehearsal of the cycle showed.
    pub rehearsal: &'o Rehearsal,
    /// Kernel, processors, interrupt.
    pub system: &'o System,
}

/// What the machine needs.
#[derive(Clone, Copy, Debug)]
pub struct Wanted {
    /// What its file asks for.
    pub settings: Settings,
    /// Latest wake-up that leaves room for all frames of a cycle.
    pub wake_error_max: Span,
}

/// All of them, from the ground up.
pub fn checks(obtained: &Obtained<'_>, wanted: &Wanted) -> Vec<Check> {
    let Obtained { memory, awake, thread, rehearsal, system } = *obtained;
    let settings = &wanted.settings;
    let mut checks: Vec<Check> = system.interface.iter().map(interface).collect();
    checks.extend([
        kernel(system),
        locked(memory.locked),
        heap(memory.is_heap_kept),
        scheduling(thread, settings),
        affinity(thread, settings),
        signals(thread),
        timer_slack(thread),
        idle_states(awake, system.has_idle_states),
        frequency(system, settings),
        isolation(system, settings),
    ]);
    let real = system.interface.iter().filter(|interface| interface.is_there && !interface.is_virtual);
    checks.extend(real.map(|interface| interrupt(interface, settings)));
    checks.extend([page_faults(rehearsal), wake_up(rehearsal, wanted.wake_error_max)]);
    checks
}

fn required(name: &'static str, found: impl Into<String>, state: State) -> Check {
    Check { name, is_required: true, found: found.into(), state }
}

fn optional(name: &'static str, found: impl Into<String>, state: State) -> Check {
    Check { name, is_required: false, found: found.into(), state }
}

fn missing(mend: impl Into<String>) -> State {
    State::Missing { mend: mend.into() }
}

/// What is not there is judged like a machine: it may come back as one.
fn interface(interface: &Interface) -> Check {
    let name = &interface.name;
    let (found, state) = match (interface.is_there, interface.is_virtual) {
        (true, true) => (format!("{name} is virtual: no machine behind it"), State::Held),
        (true, false) => (format!("{name} has a controller: a machine may be behind it"), State::Held),
        (false, _) => (
            format!("there is no {name}"),
            missing("`ip link` shows which interfaces there are; see systemd/"),
        ),
    };
    required("CAN interface", found, state)
}

fn kernel(system: &System) -> Check {
    let state = if system.is_preempt_rt {
        State::Held
    } else {
        missing("boot a PREEMPT_RT kernel (Debian: linux-image-rt-amd64)")
    };
    required("kernel", system.kernel.clone(), state)
}

fn locked(locked: Result<u64, LockRefusal>) -> Check {
    const MEND: &str = "LimitMEMLOCK=infinity in the unit, or `ulimit -l unlimited` where root starts it";
    let (found, state) = match locked {
        Ok(0) => ("the system counts no locked page".to_owned(), missing(MEND)),
        Ok(bytes) => (format!("{} MiB locked, and all to come", bytes >> 20), State::Held),
        Err(LockRefusal::Limit { bytes }) => (
            format!("not locked: the limit of {} KiB would fail later allocations", bytes >> 10),
            missing(MEND),
        ),
        Err(LockRefusal::System(errno)) => (format!("not locked: mlockall: {errno}"), missing(MEND)),
    };
    required("memory", found, state)
}

fn heap(is_kept: bool) -> Check {
    if is_kept {
        return required("heap", "a reserve is touched, and nothing is given back", State::Held);
    }
    required("heap", "the allocator may give memory back", missing("build for the C library of GNU"))
}

fn scheduling(thread: &Thread, settings: &Settings) -> Check {
    let wanted = settings.priority;
    let (found, is_held) = match thread.scheduling {
        Ok(effective) => {
            let is_held = effective.policy == Policy::Fifo && effective.priority == i32::from(wanted);
            let inherited = if effective.is_reset_on_fork { ", not inherited" } else { "" };
            (format!("{} {}{inherited}", policy_name(effective.policy), effective.priority), is_held)
        }
        Err(errno) => (format!("cannot be read: {errno}"), false),
    };
    if is_held {
        return required("scheduling", found, State::Held);
    }
    let refusal = thread.fifo.err().map(|errno| format!("; SCHED_FIFO {wanted} was refused: {errno}"));
    let mend = format!(
        "LimitRTPRIO={} and RestrictRealtime=no in the unit, or `ulimit -r {wanted}` where root starts it",
        wanted.max(90)
    );
    required("scheduling", found + &refusal.unwrap_or_default(), missing(mend))
}

fn policy_name(policy: Policy) -> String {
    match policy {
        Policy::Fifo => "SCHED_FIFO".to_owned(),
        Policy::RoundRobin => "SCHED_RR".to_owned(),
        Policy::Other => "SCHED_OTHER".to_owned(),
        Policy::Numbered(number) => format!("scheduling policy {number}"),
    }
}

fn affinity(thread: &Thread, settings: &Settings) -> Check {
    let Ok(set) = thread.cpus else {
        let found = format!("cannot be read: {}", thread.cpus.err().unwrap_or(Errno::UnknownErrno));
        return optional("affinity", found, missing("nothing is known that makes the system refuse"));
    };
    let cpus: Vec<u16> = CPUS.filter(|cpu| set.is_set(usize::from(*cpu)) == Ok(true)).collect();
    let list = cpus.iter().map(u16::to_string).collect::<Vec<_>>().join(", ");
    let Some(cpu) = settings.cpu else {
        return optional("affinity", format!("any processor of {list}"), State::Held);
    };
    if cpus == [cpu] {
        return required("affinity", format!("processor {cpu} only"), State::Held);
    }
    let refusal = thread.pinned.err().map(|errno| format!("; processor {cpu} was refused: {errno}"));
    let found = format!("processors {list}{}", refusal.unwrap_or_default());
    required(
        "affinity",
        found,
        missing("`cpu` in [real-time] must be one that runs and that the unit allows"),
    )
}

/// Numbers that a processor can have in the system's sets.
const CPUS: Range<u16> = 0..1024;

fn signals(thread: &Thread) -> Check {
    match thread.signals_blocked {
        Ok(()) => required("signals", "go to other threads", State::Held),
        Err(errno) => {
            let mend = "nothing is known that makes the system refuse";
            required("signals", format!("interrupt the cycle: {errno}"), missing(mend))
        }
    }
}

fn timer_slack(thread: &Thread) -> Check {
    match thread.timer_slack {
        Ok(slack) if slack <= Span::ns(1) => {
            optional("timer slack", format!("{} ns", slack.as_ns()), State::Held)
        }
        Ok(slack) => {
            let mend = "without a real-time policy the system puts timers together; see scheduling";
            optional("timer slack", format!("{} ns", slack.as_ns()), missing(mend))
        }
        Err(errno) => optional("timer slack", format!("cannot be set: {errno}"), missing("see scheduling")),
    }
}

fn idle_states(awake: Result<i32, Errno>, has_idle_states: bool) -> Check {
    let mend = "give the daemon's group /dev/cpu_dma_latency (systemd/60-quadrant.rules), or run it as root";
    let (found, state) = match awake {
        Ok(0) => ("none that takes time to leave, as long as the daemon runs".to_owned(), State::Held),
        Ok(bound_us) => (format!("the system allows {bound_us} us to leave one"), missing(mend)),
        Err(Errno::ENOENT) if !has_idle_states => ("the kernel enters none".to_owned(), State::Held),
        Err(errno) => (format!("/dev/cpu_dma_latency: {errno}"), missing(mend)),
    };
    required("idle states", found, state)
}

fn frequency(system: &System, settings: &Settings) -> Check {
    let is_ours = |cpu: u16| settings.cpu.is_none_or(|own| own == cpu);
    let ours: Vec<_> = system.governors.iter().filter(|(cpu, _)| is_ours(**cpu)).collect();
    let slow = ours.iter().find(|(_, governor)| *governor != "performance");
    let (found, state) = match slow {
        None if ours.is_empty() => ("not scaled by the kernel".to_owned(), State::Held),
        None => ("governor performance".to_owned(), State::Held),
        Some((cpu, governor)) => {
            let mend = "`cpupower frequency-set -g performance`, at each boot";
            (format!("processor {cpu} has governor {governor}"), missing(mend))
        }
    };
    required("frequency", found, state)
}

fn isolation(system: &System, settings: &Settings) -> Check {
    let Some(cpu) = settings.cpu else {
        let mend = "name a processor: `cpu` in [real-time], and isolate it on the kernel's command line";
        return optional("isolation", "no processor is the cycle's own", missing(mend));
    };
    let lists =
        [("isolcpus", &system.isolated), ("nohz_full", &system.nohz_full), ("rcu_nocbs", &system.rcu_nocbs)];
    let lacking: Vec<&str> = lists.iter().filter(|(_, list)| !list.has(cpu)).map(|(name, _)| *name).collect();
    if lacking.is_empty() {
        let found = format!("processor {cpu}: isolcpus, nohz_full, rcu_nocbs");
        return optional("isolation", found, State::Held);
    }
    let words: Vec<String> = lacking.iter().map(|name| format!("{name}={cpu}")).collect();
    let mend = format!("{} on the kernel's command line; measure before and after", words.join(" "));
    optional("isolation", format!("processor {cpu} lacks {}", lacking.join(", ")), missing(mend))
}

/// Frames come in by the controller's interrupt. Its thread must not wait behind other real-time work,
/// ours included; kernels give such threads 50.
fn interrupt(interface: &Interface, settings: &Settings) -> Check {
    let (name, ours) = (&interface.name, settings.priority);
    let Some(lowest) = interface.interrupts.iter().min_by_key(|thread| thread.priority) else {
        let mend = format!(
            "if /proc/interrupts shows one for it: above {ours} with chrt, or on another processor than the cycle"
        );
        return optional("CAN interrupt", format!("no thread of {name} is known"), missing(mend));
    };
    let found = format!("{} has priority {}, the cycle {ours}", lowest.name, lowest.priority);
    if lowest.priority > ours {
        return optional("CAN interrupt", found, State::Held);
    }
    let mend = format!("`chrt -f -p {} {}`, or move it to another processor", ours + 1, lowest.pid);
    optional("CAN interrupt", found, missing(mend))
}

fn page_faults(rehearsal: &Rehearsal) -> Check {
    let periods = rehearsal.periods;
    let (found, state) = match rehearsal.page_faults {
        Ok(PageFaults { minor: 0, major: 0 }) => (format!("none in {periods} periods"), State::Held),
        Ok(PageFaults { minor, major }) => {
            (format!("{minor} minor and {major} major in {periods} periods"), missing("see memory"))
        }
        Err(errno) => (format!("cannot be counted: {errno}"), missing("see memory")),
    };
    required("page faults", found, state)
}

fn wake_up(rehearsal: &Rehearsal, bound: Span) -> Check {
    let found = format!(
        "latest {:.0} us in {} periods, {} missed; borne are {:.0} us",
        rehearsal.wake_error_max.as_us(),
        rehearsal.periods,
        rehearsal.overruns,
        bound.as_us()
    );
    let state = if rehearsal.overruns == 0 && rehearsal.wake_error_max <= bound {
        State::Held
    } else {
        missing("first what else is missing here; then look for the cause with cyclictest and hwlatdetect")
    };
    required("wake-up", found, state)
}

#[cfg(test)]
mod tests {
    use super::super::system::InterruptThread;
    use super::*;
    use crate::rt::thread::Scheduling;
    use nix::sched::CpuSet;

    fn cpus(list: &[usize]) -> CpuSet {
        let mut cpus = CpuSet::new();
        list.iter().for_each(|cpu| cpus.set(*cpu).unwrap());
        cpus
    }

    /// A machine on which everything holds, to be spoiled.
    struct Bench {
        memory: Memory,
        awake: Result<i32, Errno>,
        thread: Thread,
        rehearsal: Rehearsal,
        system: System,
        settings: Settings,
    }

    impl Bench {
        fn good() -> Self {
            let fifo = Scheduling { policy: Policy::Fifo, priority: 80, is_reset_on_fork: true };
            Self {
                memory: Memory { is_heap_kept: true, locked: Ok(90 << 20) },
                awake: Ok(0),
                thread: Thread {
                    fifo: Ok(()),
                    scheduling: Ok(fifo),
                    pinned: Ok(()),
                    cpus: Ok(cpus(&[0, 1])),
                    timer_slack: Ok(Span::ZERO),
                    signals_blocked: Ok(()),
                },
                rehearsal: Rehearsal {
                    periods: 500,
                    overruns: 0,
                    wake_error_max: Span::us(12),
                    page_faults: Ok(PageFaults::default()),
                },
                system: System {
                    kernel: "6.1 PREEMPT_RT".to_owned(),
                    is_preempt_rt: true,
                    ..System::default()
                },
                settings: Settings { priority: 80, cpu: None },
            }
        }

        fn checks(&self) -> Vec<Check> {
            let Self { memory, awake, thread, rehearsal, system, settings } = self;
            let obtained = Obtained { memory: *memory, awake: *awake, thread, rehearsal, system };
            checks(&obtained, &Wanted { settings: *settings, wake_error_max: Span::us(150) })
        }

        /// What is said of one thing: `held`, or what mends it.
        fn said(&self, name: &str) -> (String, String) {
            let check = self.checks().into_iter().find(|check| check.name == name).unwrap();
            let said = match check.state {
                State::Held => "held".to_owned(),
                State::Missing { mend } => mend,
            };
            (check.found, said)
        }

        fn missing(&self) -> Vec<&'static str> {
            self.checks().iter().filter(|check| check.is_missing()).map(|check| check.name).collect()
        }
    }

    fn missing_after(spoil: impl FnOnce(&mut Bench)) -> Vec<&'static str> {
        let mut bench = Bench::good();
        spoil(&mut bench);
        bench.missing()
    }

    #[test]
    fn each_required_thing_is_missed_alone() {
        assert_eq!(Bench::good().missing(), [] as [&str; 0]);
        let other = Scheduling { policy: Policy::Other, priority: 0, is_reset_on_fork: false };
        let lower = Scheduling { policy: Policy::Fifo, priority: 79, is_reset_on_fork: true };
        let turns = Scheduling { policy: Policy::RoundRobin, priority: 80, is_reset_on_fork: true };
        type Spoil = Box<dyn FnOnce(&mut Bench)>;
        let spoils: Vec<(&str, Spoil)> = vec![
            ("kernel", Box::new(|bench| bench.system.is_preempt_rt = false)),
            ("memory", Box::new(|bench| bench.memory.locked = Ok(0))),
            ("memory", Box::new(|bench| bench.memory.locked = Err(LockRefusal::Limit { bytes: 1 << 23 }))),
            ("memory", Box::new(|bench| bench.memory.locked = Err(LockRefusal::System(Errno::EPERM)))),
            ("heap", Box::new(|bench| bench.memory.is_heap_kept = false)),
            ("scheduling", Box::new(move |bench| bench.thread.scheduling = Ok(other))),
            ("scheduling", Box::new(move |bench| bench.thread.scheduling = Ok(lower))),
            ("scheduling", Box::new(move |bench| bench.thread.scheduling = Ok(turns))),
            ("scheduling", Box::new(|bench| bench.thread.scheduling = Err(Errno::EPERM))),
            ("affinity", Box::new(|bench| bench.settings.cpu = Some(1))),
            ("signals", Box::new(|bench| bench.thread.signals_blocked = Err(Errno::EINVAL))),
            ("idle states", Box::new(|bench| bench.awake = Ok(30))),
            ("idle states", Box::new(|bench| bench.awake = Err(Errno::EACCES))),
            ("frequency", Box::new(|bench| drop(bench.system.governors.insert(0, "powersave".to_owned())))),
            (
                "page faults",
                Box::new(|bench| bench.rehearsal.page_faults = Ok(PageFaults { minor: 1, major: 0 })),
            ),
            (
                "page faults",
                Box::new(|bench| bench.rehearsal.page_faults = Ok(PageFaults { minor: 0, major: 1 })),
            ),
            ("page faults", Box::new(|bench| bench.rehearsal.page_faults = Err(Errno::EINVAL))),
            ("wake-up", Box::new(|bench| bench.rehearsal.wake_error_max = Span::us(151))),
            ("wake-up", Box::new(|bench| bench.rehearsal.overruns = 1)),
        ];
        for (number, (name, spoil)) in spoils.into_iter().enumerate() {
            assert_eq!(missing_after(spoil), [name], "case {number}");
        }
    }

    #[test]
    fn what_is_only_liked_does_not_refuse() {
        let none = [] as [&str; 0];
        assert_eq!(missing_after(|bench| bench.thread.timer_slack = Ok(Span::us(50))), none);
        assert_eq!(missing_after(|bench| bench.thread.cpus = Err(Errno::EPERM)), none);
        let isolated = Bench::good().said("isolation");
        assert!(isolated.1.contains("`cpu` in [real-time]"), "{isolated:?}");
    }

    #[test]
    fn a_kernel_without_idle_states_needs_no_device() {
        let with = |has_idle_states| {
            missing_after(|bench| {
                bench.awake = Err(Errno::ENOENT);
                bench.system.has_idle_states = has_idle_states;
            })
        };
        assert_eq!((with(false), with(true)), (vec![], vec!["idle states"]));
    }

    #[test]
    fn only_the_governor_of_the_cycles_processor_counts() {
        let mut bench = Bench::good();
        bench.system.governors = [(0, "powersave".to_owned()), (1, "performance".to_owned())].into();
        assert_eq!(bench.missing(), ["frequency"], "on any processor");
        bench.settings.cpu = Some(1);
        bench.thread.cpus = Ok(cpus(&[1]));
        assert_eq!(bench.missing(), [] as [&str; 0]);
        bench.system.governors.insert(1, "schedutil".to_owned());
        assert_eq!(bench.missing(), ["frequency"]);
    }

    #[test]
    fn a_refusal_is_told_with_its_cause_and_cure() {
        let mut bench = Bench::good();
        bench.settings.cpu = Some(7);
        bench.thread.pinned = Err(Errno::EINVAL);
        bench.thread.fifo = Err(Errno::EPERM);
        bench.thread.scheduling =
            Ok(Scheduling { policy: Policy::Other, priority: 0, is_reset_on_fork: false });
        let (found, mend) = bench.said("scheduling");
        assert_eq!(found, "SCHED_OTHER 0; SCHED_FIFO 80 was refused: EPERM: Operation not permitted");
        assert!(mend.contains("LimitRTPRIO=90") && mend.contains("ulimit -r 80"), "{mend}");
        let (found, _) = bench.said("affinity");
        assert_eq!(found, "processors 0, 1; processor 7 was refused: EINVAL: Invalid argument");
        let (found, mend) = bench.said("isolation");
        assert_eq!(found, "processor 7 lacks isolcpus, nohz_full, rcu_nocbs");
        assert!(mend.starts_with("isolcpus=7 nohz_full=7 rcu_nocbs=7 on"), "{mend}");
    }

    #[test]
    fn the_interrupt_of_a_real_controller_is_told() {
        let thread = |name: &str, priority| InterruptThread { pid: 141, name: name.to_owned(), priority };
        let mut bench = Bench::good();
        let names = |bench: &Bench| bench.checks().iter().map(|check| check.name).collect::<Vec<_>>();
        assert!(!names(&bench).contains(&"CAN interrupt"), "frames stay in memory");
        let interrupts = vec![thread("irq/42-can0", 90), thread("irq/41-can0", 50)];
        let name = "can0".to_owned();
        bench.system.interface = Some(Interface { name, is_there: true, is_virtual: false, interrupts });
        let (found, mend) = bench.said("CAN interrupt");
        assert_eq!(found, "irq/41-can0 has priority 50, the cycle 80");
        assert!(mend.contains("chrt -f -p 81 141"), "{mend}");
        let interface = bench.system.interface.as_mut().unwrap();
        interface.interrupts.truncate(1);
        assert_eq!(bench.said("CAN interrupt").1, "held");
        let interface = bench.system.interface.as_mut().unwrap();
        interface.interrupts.clear();
        assert_eq!(bench.said("CAN interrupt").0, "no thread of can0 is known");
        assert_eq!(bench.missing(), [] as [&str; 0], "said, not required");
        bench.system.interface.as_mut().unwrap().is_virtual = true;
        assert!(!names(&bench).contains(&"CAN interrupt"), "vcan has none");
        let gone = Interface { name: "can0".to_owned(), ..Interface::default() };
        bench.system.interface = Some(gone);
        assert_eq!(bench.said("CAN interface").0, "there is no can0");
        assert_eq!(bench.missing(), ["CAN interface"]);
    }
}
