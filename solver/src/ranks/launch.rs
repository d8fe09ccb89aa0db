//! Start as one of several processes, and its end.

use cd_formats::error::{Fault, Faults};

use super::{Communicator, SingleRank};

/// Variables in which launchers of MPI programs give the number of processes.
const SIZE_VARIABLES: [&str; 3] = ["OMPI_COMM_WORLD_SIZE", "PMI_SIZE", "MV2_COMM_WORLD_SIZE"];

/// Variables that a process has if a launcher of MPI programs has started it.
#[cfg(feature = "mpi")]
const LAUNCH_VARIABLES: [&str; 6] =
    ["OMPI_COMM_WORLD_SIZE", "PMI_SIZE", "PMI_RANK", "PMIX_RANK", "MV2_COMM_WORLD_SIZE", "PALS_RANKID"];

/// Communicator of a run, from its start to its end. If it is dropped during a panic, all ranks end.
pub struct RankSession {
    pub communicator: &'static dyn Communicator,
    #[cfg(feature = "mpi")]
    _universe: Option<mpi::environment::Universe>,
}

impl Drop for RankSession {
    fn drop(&mut self) {
        if self.communicator.size() > 1 && std::thread::panicking() {
            self.communicator.abort(PANIC_CODE);
        }
    }
}

/// Exit code of a program that panics.
const PANIC_CODE: i32 = 101;

/// Joins the other processes of the launcher; a process that no launcher has started is alone.
///
/// Errors: this build is without MPI and one of several processes, or the MPI library lets only the first thread communicate.
pub fn begin_session() -> Result<RankSession, Faults> {
    #[cfg(feature = "mpi")]
    if LAUNCH_VARIABLES.iter().any(|name| std::env::var_os(name).is_some())
        && let Some((universe, threading)) = mpi::initialize_with_threading(mpi::Threading::Serialized)
    {
        if threading < mpi::Threading::Serialized {
            let found = "no thread but the first may communicate";
            let expected = "expected a build of it with MPI_THREAD_SERIALIZED";
            return Err(Fault::new("mpirun".as_ref(), None, "MPI library", found, expected).into());
        }
        let communicator = Box::leak(Box::new(super::mpi_communicator::MpiCommunicator::new()));
        return Ok(RankSession { communicator, _universe: Some(universe) });
    }
    let is_several = |name: &&&str| std::env::var(name).is_ok_and(|size| size.parse().is_ok_and(|size: u64| size > 1));
    if !cfg!(feature = "mpi")
        && let Some(name) = SIZE_VARIABLES.iter().find(is_several)
    {
        let found = format!(
            "is one of {} processes, and this cd-solve is built without MPI",
            std::env::var(name).unwrap_or_default()
        );
        let expected = format!(
            "expected a build by `cargo build --release -p cd-solve --features mpi`, or a start without mpirun; to run alone nevertheless, unset {name}"
        );
        return Err(Fault::new("mpirun".as_ref(), None, "process", found, expected).into());
    }
    Ok(RankSession {
        communicator: &SingleRank,
        #[cfg(feature = "mpi")]
        _universe: None,
    })
}
