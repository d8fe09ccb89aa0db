fn main() {
    cd_formats::atomic::outlive_size_limit();
    cd_formats::command_line::set_version(cd_version::version!());
    std::process::exit(cd_post::run(std::env::args_os()))
}
