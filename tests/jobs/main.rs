//! Store, queue and workers, through their public interface and, where bytes have to be damaged, through the file.

mod clouds;
mod durability;
mod model;
mod queue;
mod results;
mod stage;
mod workers;
