//! The program cd-pre: sets the version and runs [`cd_pre::run`].

fn main() {
    cd_formats::atomic::turn_size_limit_into_error();
    cd_formats::command_line::set_version(cd_version::version!());
    let code = cd_pre::run(std::env::args_os());
    std::process::exit(cd_formats::messages::exit_code("cd-pre", code))
}
