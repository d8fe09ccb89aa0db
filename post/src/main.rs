//! The program cd-post: sets the version and runs [`cd_post::run`].

fn main() {
    cd_formats::atomic::turn_size_limit_into_error();
    cd_formats::command_line::set_version(cd_version::version!());
    std::process::exit(cd_post::run(std::env::args_os()))
}
