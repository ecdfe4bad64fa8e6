//! Services that die, hang, talk nonsense or dawdle: what the launcher says and does, and what becomes of the map.

mod early;
mod full_memory;
mod given_up;
mod graph_file;
mod limits;
mod live;
mod orders;
mod sensors;
mod signals;
mod stopped;
mod strangers;
mod systemd;
mod twenty;
mod wiring;
