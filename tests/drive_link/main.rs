//! Promise: the drives see of their boards what is true, or know that they do not. Boards of
//! `sim::board` stand at the other end of a memory bus, with faults in between.

mod boards;
mod commissioning;
mod halves;
mod rig;
mod samples;
