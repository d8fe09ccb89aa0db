//! The program cd-post: sets the version and runs [`cd_post::run`].

fn main() {
    cd_formats::atomic::turn_size_limit_into_error();
    cd_formats::command_line::set_version(cd_version::version!());
    let code = cd_post::run(std::env::args_os());
    std::process::exit(cd_formats::messages::exit_code("cd-post", code))
}
