//! The program cd-solve: sets the version and runs [`cd_solve::run`].

fn main() {
    cd_formats::atomic::turn_size_limit_into_error();
    cd_formats::command_line::set_version(cd_version::version!());
    std::process::exit(cd_solve::run(std::env::args_os()))
}
